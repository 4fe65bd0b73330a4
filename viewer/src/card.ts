/** What is known of the selected fruit, and crops of the photos that saw it. */

import { cropButton, drawOutlines } from "./crop";
import { button, element } from "./dom";
import { measured, short } from "./locale";
import type { Fruit, Photo, Sighting } from "./payload";
import type { PhotoSource, Seen } from "./source";

const FIRST = 12;

export interface CardWants {
  metric: boolean;
  unit: string;
  origin: [number, number, number];
  onClose(): void;
  onOpen(sighting: Sighting): void;
}

/** Pairs of label and text; what was not measured says why. */
export function facts(fruit: Fruit, wants: Pick<CardWants, "metric" | "unit" | "origin">): [string, string][] {
  const missing = fruit.reason ? `not measured: ${fruit.reason}` : "not measured";
  const size = (value: number): string => (wants.metric ? measured(1000 * value, 1) : short(value, 3));
  const sizeUnit = wants.metric ? "mm" : wants.unit;
  const spread = Number.isFinite(fruit.diameterSd) ? ` ± ${size(fruit.diameterSd)}` : "";
  const place = [fruit.x, fruit.y, fruit.z].map((v, axis) => measured(v + wants.origin[axis]!, 3)).join("; ");
  const pairs: [string, string][] = [
    ["Score", measured(fruit.score, 2)],
    ["Diameter", Number.isFinite(fruit.diameter) ? `${size(fruit.diameter)}${spread} ${sizeUnit}` : missing],
  ];
  if (Number.isFinite(fruit.weight)) pairs.push(["Weight", `${measured(fruit.weight, 0)} g`]);
  if (fruit.tree) pairs.push(["Tree", String(fruit.tree)]);
  if (fruit.side) pairs.push(["Side", fruit.side]);
  pairs.push(["Seen in", `${fruit.views} photo${fruit.views === 1 ? "" : "s"}`], ["x, y, z", `${place} ${wants.unit}`]);
  return pairs;
}

/** Show what is known of a fruit; its crops follow. */
export function fillCard(card: HTMLElement, fruit: Fruit, wants: CardWants): void {
  const list = element("dl");
  for (const [label, text] of facts(fruit, wants)) list.append(element("dt", label), element("dd", text));
  const heading = element("h3", `Fruit ${fruit.id}`);
  heading.tabIndex = -1;
  card.replaceChildren(button("×", "Close", wants.onClose, "close"), heading, list);
  card.hidden = false;
}

/** Add the crops of the photos that saw the fruit. */
export function addCrops(card: HTMLElement, fruit: Fruit, seen: Seen, photos: Photo[], source: PhotoSource, wants: CardWants): void {
  const crops = element("div", "", "crops");
  card.append(crops);
  const pictures = seen.sightings.map((sighting) => ({ sighting, picture: source.crop(sighting, photos[sighting.photo]!) }));
  const shown = pictures.filter(({ picture }) => picture);
  // Photos without a picture are named where there are none with one.
  const all = shown.length ? shown : pictures;
  const add = (from: number, to: number): void => {
    for (const { sighting, picture } of all.slice(from, to)) {
      crops.append(cropButton(sighting, photos[sighting.photo]!, picture, fruit.id, () => wants.onOpen(sighting)));
    }
    drawOutlines(crops, seen.sightings, seen.detections);
  };
  add(0, FIRST);
  if (all.length > FIRST) {
    const more = button(`Show all ${all.length} photos`, "", () => {
      more.remove();
      add(FIRST, all.length);
    }, "more");
    card.append(more);
  }
  const missing = seen.sightings.some(({ photo }) => !source.hasPhoto(photos[photo]!));
  if (missing && source.note) card.append(element("p", source.note, "note"));
}
