/** Clicking fruits in photos: the middle of a missed one in two or more, or of two that were taken for one. */

import type { PhotoMark, SightLines, SurveyData } from "./contract";
import { find, say, svg } from "./dom";
import { measured, short } from "./locale";
import type { Box, Photo } from "./payload";
import type { PhotoWindow } from "./photo";

export interface Marked {
  kind: "add" | "split";
  fruits: number[];
  marks: PhotoMark[];
  size: PhotoMark[];
}

/** How much of the photo is shown around a line, in lengths of it. */
const AROUND = 1.6;
const LEAST_SHOWN_PX = 400;

/** The marks after one more: for adding one a photo, for splitting two in one photo. */
export function withMark(kind: Marked["kind"], marks: PhotoMark[], mark: PhotoMark): PhotoMark[] {
  const others = marks.filter(({ photo }) => (photo === mark.photo) === (kind === "split"));
  return [...(kind === "split" ? others.slice(-1) : others), mark];
}

/** What to do next, in words. */
export function advice({ kind, fruits, marks, size }: Marked, sizing: boolean): string {
  if (sizing) return size.length === 1 ? "Now click its opposite edge." : "Click one edge of the fruit.";
  if (kind === "split") {
    if (marks.length === 2) return "Split it, or click again.";
    return marks.length ? "Now click the middle of the other fruit." : `Click the middle of one of the two fruits that were taken for fruit ${fruits[0]}.`;
  }
  if (!marks.length) return "Click the middle of the missed fruit.";
  if (marks.length === 1) return "Now click the same fruit in another photo: it lies on the line. Previous and Next step through photos that may show it.";
  return "Add it, or click it in more photos, or say how large it is.";
}

/** The box around a line, wide enough to see what is around it. */
export function boxAround(line: ArrayLike<number>): Box {
  const xs = Array.from(line).filter((_, i) => i % 2 === 0);
  const ys = Array.from(line).filter((_, i) => i % 2 === 1);
  const [x0, x1, y0, y1] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const side = Math.max(AROUND * Math.max(x1 - x0, y1 - y0), LEAST_SHOWN_PX);
  return [(x0 + x1 - side) / 2, (y0 + y1 - side) / 2, side, side];
}

export class Marking {
  private now: Marked | null = null;
  private sizing = false;
  /** Where other photos may show what is marked in one, by the marked photo. */
  private readonly lines = new Map<number, Map<number, number[]>>();
  private readonly bar = find("#marking");
  private readonly text = find("#marking-text");
  private readonly done = find<HTMLButtonElement>("#marking-done");
  private readonly size = find<HTMLButtonElement>("#marking-size");
  private readonly back = find<HTMLButtonElement>("#marking-back");
  private readonly drawing = find<SVGSVGElement>("#photo svg.marks");

  constructor(
    private readonly window: PhotoWindow, private readonly photos: Photo[], private readonly data: SurveyData,
    private readonly onDone: (marked: Marked) => Promise<string | null>,
  ) {
    find("#marking-here").addEventListener("click", () => window.markMiddle());
    find("#marking-cancel").addEventListener("click", () => this.stop());
    this.back.addEventListener("click", () => this.takeBack());
    this.size.addEventListener("click", () => this.startSizing());
    this.done.addEventListener("click", () => void this.finish());
    window.onShow = () => this.draw();
    window.onClose = () => this.stop();
  }

  /** Begin in a photo, or in the part of it that `box` shows. */
  start(what: Pick<Marked, "kind" | "fruits">, photo: number, box?: Box): void {
    this.now = { ...what, marks: [], size: [] };
    this.sizing = false;
    this.lines.clear();
    this.bar.hidden = false;
    this.done.textContent = what.kind === "add" ? "Add fruit" : "Split fruit";
    this.size.hidden = what.kind === "split";
    this.window.onMark = (x, y) => void this.mark({ photo: this.window.photo, x, y });
    this.window.order = null;
    this.window.openAt(photo, box && [box[0] - box[2], box[1] - box[3], 3 * box[2], 3 * box[3]]);
    this.advise();
  }

  private stop(): void {
    if (!this.now) return;
    this.now = null;
    this.bar.hidden = true;
    this.window.onMark = null;
    this.window.order = null;
    this.drawing.replaceChildren();
    say("Nothing more is marked.");
  }

  private async mark(mark: PhotoMark): Promise<void> {
    const { now } = this;
    if (!now) return;
    const { width, height } = this.photos[mark.photo]!;
    if (mark.x < 0 || mark.y < 0 || mark.x > width || mark.y > height) {
      this.tell("That is beside the photo: click in it.");
      return;
    }
    if (this.sizing) {
      now.size = [...now.size.filter(({ photo }) => photo === mark.photo).slice(-1), mark];
      this.sizing = now.size.length < 2;
      this.advise();
      return;
    }
    now.marks = withMark(now.kind, now.marks, mark);
    this.advise();
    if (now.kind === "split") return;
    await this.find(mark);
    const next = this.window.order?.find((photo) => !now.marks.some((other) => other.photo === photo));
    if (this.now === now && now.marks.length === 1 && next !== undefined) this.window.openAt(next, this.boxIn(next));
    this.advise();
  }

  /** Ask where other photos may show what was marked. */
  private async find(mark: PhotoMark): Promise<void> {
    try {
      const answer = await fetch(`data/lines/${mark.photo}/${Math.floor(mark.x)}/${Math.floor(mark.y)}.json`);
      if (!answer.ok) return;
      const { photos, lines } = (await answer.json()) as SightLines;
      this.lines.set(mark.photo, new Map(photos.map((photo, i) => [photo, lines[i]!])));
      if (this.now?.marks[0]?.photo === mark.photo) this.window.order = [...photos, mark.photo];
    } catch {
      // Without the line a fruit can still be clicked.
    }
  }

  private boxIn(photo: number): Box | undefined {
    const line = this.now && this.lines.get(this.now.marks[0]!.photo)?.get(photo);
    return line ? boxAround(line) : undefined;
  }

  private takeBack(): void {
    const { now } = this;
    if (!now) return;
    if (now.size.length) now.size = now.size.slice(0, -1);
    else if (this.sizing) this.sizing = false;
    else now.marks = now.marks.slice(0, -1);
    if (!now.marks.length) this.window.order = null;
    this.advise();
  }

  private startSizing(): void {
    if (!this.now) return;
    this.now.size = [];
    this.sizing = true;
    this.advise();
  }

  private async finish(): Promise<void> {
    if (!this.now) return;
    const problem = await this.onDone(this.now);
    if (problem) this.tell(problem);
  }

  private advise(): void {
    const { now } = this;
    if (!now) return;
    this.done.disabled = now.marks.length < 2 || this.sizing;
    this.size.disabled = now.marks.length < 1;
    this.back.disabled = !now.marks.length;
    const usual = this.data.corrections?.usualDiameter;
    const width = usual && (this.data.metric ? `${measured(1000 * usual, 0)} mm` : short(usual, 3));
    const size = now.size.length === 2 ? " Its size is as clicked." : now.kind === "add" && now.marks.length > 1 && width ? ` It is taken to be ${width} wide, as the others are.` : "";
    this.tell(advice(now, this.sizing) + (this.sizing ? "" : size));
    this.draw();
  }

  private tell(text: string): void {
    this.text.textContent = text;
  }

  /** Marks of this photo, and lines on which those of other photos lie here. */
  private draw(): void {
    const { now } = this;
    if (!now) return;
    const { photo } = this.window;
    const { width, height } = this.photos[photo]!;
    this.drawing.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const here = (mark: PhotoMark): boolean => mark.photo === photo;
    const shapes: SVGElement[] = now.marks.filter((mark) => !here(mark)).flatMap((mark) => {
      const line = this.lines.get(mark.photo)?.get(photo);
      return line ? [svg("path", { d: openPath(line), class: "sight" })] : [];
    });
    const edges = now.size.filter(here);
    if (edges.length === 2) shapes.push(svg("path", { d: openPath(edges.flatMap(({ x, y }) => [x, y])), class: "edge" }));
    // A line of no length with round ends is a dot that is as large at any zoom.
    for (const { x, y } of [...now.marks.filter(here), ...edges]) {
      for (const name of ["dot under", "dot"]) shapes.push(svg("path", { d: `M${x.toFixed(1)} ${y.toFixed(1)}h0.01`, class: name }));
    }
    this.drawing.replaceChildren(...shapes);
  }
}

/** A path through points x, y, x, y … */
function openPath(points: ArrayLike<number>): string {
  let path = "";
  for (let i = 0; i + 1 < points.length; i += 2) path += `${i ? "L" : "M"}${points[i]!.toFixed(1)} ${points[i + 1]!.toFixed(1)}`;
  return path;
}
