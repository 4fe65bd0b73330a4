/** Marks of fruits in a photo: drawn between two points, found again by a click, undone. */

import type { MarkView } from "./contract";

export type Point = [number, number];
export type Shape = "circle" | "box";

/** The steps that can be taken back: the marks before each, and whether they were all. */
export interface Marking {
  marks: MarkView[];
  complete: boolean;
  before: { marks: MarkView[]; complete: boolean }[];
}

const SMALLEST_PX = 3;

/** A mark between two points: opposite corners of a box, or opposite points on a circle's rim; null where too small. */
export function between(shape: Shape, [ax, ay]: Point, [bx, by]: Point, [width, height]: Point): MarkView | null {
  let [x0, y0, x1, y1] = [Math.min(ax, bx), Math.min(ay, by), Math.max(ax, bx), Math.max(ay, by)];
  let circle: number[] | null = null;
  if (shape === "circle") {
    const [x, y, radius] = [(ax + bx) / 2, (ay + by) / 2, Math.hypot(bx - ax, by - ay) / 2];
    circle = [x, y, radius].map(rounded);
    [x0, y0, x1, y1] = [x - radius, y - radius, x + radius, y + radius];
  }
  const box = [Math.max(0, x0), Math.max(0, y0), Math.min(width, x1), Math.min(height, y1)].map(rounded);
  return box[2]! - box[0]! < SMALLEST_PX || box[3]! - box[1]! < SMALLEST_PX ? null : { box, circle };
}

/** The mark whose outline runs within `reach` of a point, the nearest one; -1 for none. */
export function outlineAt(marks: MarkView[], [x, y]: Point, reach: number): number {
  let [best, nearest] = [-1, reach];
  marks.forEach(({ box, circle }, i) => {
    const away = circle ? Math.abs(Math.hypot(x - circle[0]!, y - circle[1]!) - circle[2]!) : toBox(box, x, y);
    if (away <= nearest) [best, nearest] = [i, away];
  });
  return best;
}

function toBox(box: number[], x: number, y: number): number {
  const [left, top, right, bottom] = [box[0]! - x, box[1]! - y, x - box[2]!, y - box[3]!];
  const outside = [Math.max(left, right, 0), Math.max(top, bottom, 0)] as const;
  return outside[0] || outside[1] ? Math.hypot(...outside) : -Math.max(left, top, right, bottom);
}

export function changed(now: Marking, marks: MarkView[], complete = now.complete): Marking {
  return { marks, complete, before: [...now.before, { marks: now.marks, complete: now.complete }] };
}

export function undone(now: Marking): Marking {
  const last = now.before.at(-1);
  return last ? { ...last, before: now.before.slice(0, -1) } : now;
}

/** A part of a photo that is looked at: x, y, width, height in its pixels. */
export type Window = [number, number, number, number];

/** The part nearer to a point by a factor, never more than the photo, never less than a thirtieth of it. */
export function zoomed([x, y, w, h]: Window, by: number, [px, py]: Point, [width, height]: Point): Window {
  const scale = Math.min(Math.max(1 / by, width / 30 / w), Math.max(width / w, height / h));
  return inside([px - (px - x) * scale, py - (py - y) * scale, w * scale, h * scale], [width, height]);
}

/** The part moved so that its middle stays in the photo. */
export function inside([x, y, w, h]: Window, [width, height]: Point): Window {
  return [Math.min(Math.max(x, -w / 2), width - w / 2), Math.min(Math.max(y, -h / 2), height - h / 2), w, h];
}

function rounded(value: number): number {
  return Math.round(value * 10) / 10;
}
