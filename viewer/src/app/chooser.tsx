/** Folders and files of this computer to choose from, as the server lists them. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { Listing, Place } from "./contract";
import { number, texts } from "./language";
import { Dialog, Problem } from "./parts";
import { ask } from "./server";

type Kind = "photos" | "survey" | "table";

function contents(place: { photos: number; videos: number }): string {
  const t = texts();
  const parts = [place.photos ? t.photos(place.photos, number(place.photos)) : "", place.videos ? t.videos(place.videos) : ""];
  return parts.filter(Boolean).join(", ");
}

export function Chooser({ title, kind, start, roots, onChoose, onClose }: { title: string; kind: Kind; start: string; roots: string[]; onChoose: (path: string) => void; onClose: () => void }) {
  const t = texts();
  const [listing, setListing] = useState<Listing | null>(null);
  const [problem, setProblem] = useState("");
  const open = async (path: string) => {
    try {
      setListing(await ask<Listing>(`folders?path=${encodeURIComponent(path)}${kind === "survey" ? "" : `&files=${kind}`}`));
      setProblem("");
    } catch (error) {
      setProblem((error as Error).message);
      if (path !== roots[0] && !listing) await open(roots[0]!);
    }
  };
  useEffect(() => void open(start), []);
  const list = useRef<HTMLUListElement>(null);
  useEffect(() => {
    // The folder whose button was pressed is open now: the keyboard goes on with what is in it.
    if (document.activeElement !== document.body) return;
    const dialog = list.current?.closest("dialog");
    const next = [".places button", ".foot button", ".bar button:enabled:not(.plain)"].map((each) => dialog?.querySelector<HTMLElement>(each));
    next.find(Boolean)?.focus();
  }, [listing]);
  const chosen = (place: Place) => (!place.isFolder || (kind === "survey" && place.isSurvey) ? onChoose(place.path) : void open(place.path));
  return (
    <Dialog title={title} onClose={onClose}>
      {listing && (
        <div class="bar">
          <select aria-label={t.roots} value={roots.filter((root) => listing.path.startsWith(root)).sort((a, b) => b.length - a.length)[0]} onChange={(event) => open(event.currentTarget.value)}>
            {roots.map((root, i) => (
              <option key={root} value={root}>
                {i ? root : t.home}
              </option>
            ))}
          </select>
          <button type="button" disabled={!listing.parent} onClick={() => open(listing.parent)}>
            {t.up}
          </button>
          <span class="path">{listing.path}</span>
        </div>
      )}
      {problem && <Problem text={problem} />}
      <ul class="places" ref={list}>
        {listing?.places.map((place) => (
          <li key={place.path}>
            <button type="button" onClick={() => chosen(place)}>
              <svg viewBox="0 0 16 16" aria-hidden="true">
                {place.isFolder ? <path d="M1 3h5l2 2h7v9H1z" /> : <path d="M3 1h7l3 3v11H3zM10 1v3h3" />}
              </svg>
              <span>{place.name}</span>
              <span class="soft">{place.isSurvey ? t.aSurvey : contents(place)}</span>
            </button>
          </li>
        ))}
      </ul>
      {listing && !listing.places.length && <p class="soft inside">{contents(listing) || t.emptyFolder}</p>}
      {kind === "photos" && listing && (
        <div class="bar foot">
          <span class="soft">{contents(listing)}</span>
          <button type="button" class="main" onClick={() => onChoose(listing.path)}>
            {t.chooseThis}
          </button>
        </div>
      )}
    </Dialog>
  );
}
