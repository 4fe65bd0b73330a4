/** Photos that still arrive: how far it is, what is the matter with a photo, and the view of the answer so far. */

import type { SurveyData, WatchHint, WatchState } from "./contract";
import { forget, remember, type Sight } from "./correct-memory";
import { button, element, find, say } from "./dom";
import { measured } from "./locale";
import type { Detection, Photo, Sighting } from "./payload";
import type { PhotoSource } from "./source";
import type { View } from "./view";

/** What following asks of the page. */
export interface Followed {
  data: SurveyData;
  photos: Photo[];
  source: PhotoSource;
  view: View | null;
  /** Of the selected fruit. */
  sightings(): Sighting[];
  select(id: number): void;
}

// The page of an answer is at `at/REVISION/`.
const ROOT = "../../";
/** While somebody turns the view or reads a photo, it is not taken away. */
const STILL_MS = 2500;
/** And a page stays for so long: loading one takes a phone a second or two. */
const STAYS_MS = 8000;

class Following {
  private readonly sheet = element("section", "", "sheet watch");
  private readonly figures = element("p", "", "figures");
  private readonly doing = element("p", "Asking how far it is …", "note");
  private readonly hints = element("ul");
  private readonly stop = button("Stop and make the survey", "", () => void this.end());
  private readonly events = new EventSource(`${ROOT}events`);
  private readonly revision = Number(/\/at\/(\d+)\/$/.exec(location.pathname)?.[1] ?? 0);
  private newest: WatchState | null = null;
  private told = "";
  private touched = 0;
  private timer = 0;

  constructor(private readonly page: Followed) {
    const line = element("div", "", "line");
    line.append(this.doing, this.stop);
    this.sheet.setAttribute("aria-label", "Photos that arrive");
    const note = element("p", "An answer so far: metres are approximate, and fruits that both sides show count twice.", "note");
    this.sheet.append(this.figures, note, line, this.hints);
    find("main").prepend(this.sheet);
    // What the report says of a finished survey is not known yet.
    document.documentElement.classList.add("provisional");
    const kept = forget(page.data, page.view);
    if (kept?.sight) void this.selectAgain(kept.sight);
    for (const kind of ["pointerdown", "wheel", "keydown", "touchmove"]) {
      document.addEventListener(kind, () => (this.touched = Date.now()), { capture: true, passive: true });
    }
    this.events.addEventListener("message", (event) => this.show(JSON.parse(String(event.data)) as WatchState));
    this.events.addEventListener("error", () => {
      if (this.newest?.phase !== "finished") this.doing.textContent = "The watch does not answer: was it ended?";
    });
  }

  private show(state: WatchState): void {
    this.newest = state;
    this.figures.replaceChildren(...figuresOf(state));
    this.doing.textContent = state.phase === "finished" ? `Finished. The survey is in ${state.doing}; pomona view shows it.` : `${state.doing} …`;
    this.stop.hidden = state.phase === "finishing" || state.phase === "finished";
    this.hints.replaceChildren(...state.hints.map(hintOf));
    const [newest] = state.hints;
    if (newest && this.told !== newest.photo + newest.matter) say(`${newest.photo} ${newest.text}`);
    this.told = newest ? newest.photo + newest.matter : "";
    if (state.phase === "finished") this.events.close();
    else this.follow();
  }

  /** Go to the page of the newest answer, as soon as that disturbs nobody. */
  private follow(): void {
    window.clearTimeout(this.timer);
    // A watch that was begun anew counts anew.
    if (!this.newest || this.newest.revision === this.revision) return;
    const busy = document.hidden || document.querySelector("dialog[open]") || performance.now() < STAYS_MS || Date.now() - this.touched < STILL_MS;
    if (busy) {
      this.timer = window.setTimeout(() => this.follow(), STILL_MS);
      return;
    }
    this.events.close();
    remember(this.page.data, this.page.view, { message: "", fruit: 0, fly: false, sight: this.sight() });
    location.replace(`${ROOT}at/${this.newest.revision}/`);
  }

  /** Where the largest photo of the selected fruit shows it. */
  private sight(): Sight | undefined {
    const [largest] = this.page.sightings();
    if (!largest) return undefined;
    const [x, y, width, height] = largest.box;
    return { photo: this.page.photos[largest.photo]!.name, x: x + width / 2, y: y + height / 2, half: width / 2 };
  }

  /** Select the fruit that is there in the photo now: with each answer, fruits are numbered anew. */
  private async selectAgain(sight: Sight): Promise<void> {
    const { photos, source, select } = this.page;
    const photo = photos.find(({ name }) => name === sight.photo);
    const detections = photo ? await source.ofPhoto(photo.index).catch(() => []) : [];
    const fruit = fruitAt(detections, sight);
    if (fruit && !this.touched) select(fruit);
  }

  private async end(): Promise<void> {
    this.stop.disabled = true;
    try {
      await fetch(`${ROOT}stop`, { method: "POST" });
    } catch {
      this.stop.disabled = false;
      this.doing.textContent = "The watch does not answer: was it ended?";
    }
  }
}

/** The number of the fruit that a photo shows at a place; 0 where nothing there became one. */
export function fruitAt(detections: Detection[], { x, y, half }: Pick<Sight, "x" | "y" | "half">): number {
  // A crop is twice as wide as its fruit.
  let [nearest, found] = [half / 2, 0];
  for (const { outline, fruit } of detections) {
    const [across, down] = [0, 1].map((axis) => outline.filter((_, i) => i % 2 === axis)) as [Float32Array, Float32Array];
    const away = Math.hypot((Math.min(...across) + Math.max(...across)) / 2 - x, (Math.min(...down) + Math.max(...down)) / 2 - y);
    if (away < nearest) [nearest, found] = [away, fruit];
  }
  return found;
}

/** The figures so far, each with what it is. */
export function figuresOf(state: WatchState): HTMLElement[] {
  const { photos, placed, fruits, length, step, wellSeen, phase } = state;
  const known: [string, string][] = [];
  if (fruits !== null) known.push([fruits.toLocaleString(), `${fruits === 1 ? "fruit" : "fruits"}${phase === "finished" ? "" : " so far"}`]);
  known.push([`${placed} of ${photos}`, photos === 1 ? "photo has a place" : "photos have a place"]);
  if (length !== null) known.push([`${measured(length, 1)} m`, `of row${step === null ? "" : `, a photo each ${(100 * step).toFixed(0)} cm`}`]);
  if (wellSeen !== null) known.push([`${Math.round(100 * wellSeen)} %`, "of the fruits seen in three photos or more"]);
  return known.map(([value, what]) => {
    const one = element("span");
    one.append(element("strong", value), ` ${what}`);
    return one;
  });
}

function hintOf(hint: WatchHint): HTMLElement {
  const item = element("li");
  item.append(element("strong", hint.photo), ` ${hint.text}.`);
  return item;
}

/** Follow a watch, where the page is one's. */
export function following(page: Followed): void {
  if (page.data.provisional) new Following(page);
}
