/** Colours of the fruits in the 3D view: one colour, or by a measurement, side or tree. */

import { median, type Fruit } from "./payload";

export type ColourBy = "fruit" | "diameter" | "score" | "views" | "side" | "tree" | "truth" | "growth" | "change";
export type Rgb = [number, number, number];

export const APPLE: Rgb = [0.79, 0.16, 0.16];
const UNKNOWN: Rgb = [0.55, 0.55, 0.55];

/** Viridis (matplotlib, CC0) at nine places; perceptually even, readable with colour blindness. */
const VIRIDIS: Rgb[] = [
  [0.267, 0.005, 0.329], [0.279, 0.175, 0.483], [0.23, 0.322, 0.546], [0.173, 0.449, 0.558], [0.128, 0.567, 0.551],
  [0.158, 0.684, 0.502], [0.37, 0.789, 0.383], [0.678, 0.864, 0.19], [0.993, 0.906, 0.144],
];

/** Okabe and Ito's qualitative colours. */
const CATEGORIES: Rgb[] = [
  [0.9, 0.62, 0.0], [0.34, 0.71, 0.91], [0.0, 0.62, 0.45], [0.94, 0.89, 0.26], [0.0, 0.45, 0.7], [0.84, 0.37, 0.0], [0.8, 0.47, 0.65],
];

export interface Colouring {
  of(fruit: Fruit): Rgb;
  /** What the legend says: a range, or categories. */
  range?: [number, number];
  categories?: [string, Rgb][];
}

export function ramp(t: number): Rgb {
  if (!Number.isFinite(t)) return UNKNOWN;
  const at = Math.min(Math.max(t, 0), 1) * (VIRIDIS.length - 1);
  const i = Math.min(Math.floor(at), VIRIDIS.length - 2);
  const [a, b] = [VIRIDIS[i]!, VIRIDIS[i + 1]!];
  return a.map((v, k) => v + (b[k]! - v) * (at - i)) as Rgb;
}

export const css = (rgb: Rgb): string => `rgb(${rgb.map((v) => Math.round(v * 255)).join(" ")})`;
export const rampCss = (): string => `linear-gradient(90deg, ${VIRIDIS.map(css).join(", ")})`;

/** By what each fruit has, `of` it. */
export function byNumber(values: number[], of: (fruit: Fruit) => number): Colouring {
  const finite = values.filter(Number.isFinite).sort((a, b) => a - b);
  if (!finite.length) return { of: () => UNKNOWN };
  // The extreme 2 % would leave all others in one colour.
  const low = finite[Math.floor(0.02 * (finite.length - 1))]!;
  const high = finite[Math.ceil(0.98 * (finite.length - 1))]!;
  const span = high - low || 1;
  return { of: (fruit) => ramp((of(fruit) - low) / span), range: [low, high] };
}

function byName(fruits: Fruit[], name: (fruit: Fruit) => string): Colouring {
  const names = [...new Set(fruits.map(name))].sort((a, b) => a.localeCompare(b, undefined, { numeric: true }));
  const colours = new Map(names.map((n, i) => [n, n === "" ? UNKNOWN : CATEGORIES[i % CATEGORIES.length]!]));
  return { of: (fruit) => colours.get(name(fruit)) ?? UNKNOWN, categories: [...colours].map(([n, c]) => [n || "not known", c]) };
}

export function colouring(by: ColourBy, fruits: Fruit[]): Colouring {
  const number = (of: (fruit: Fruit) => number): Colouring => byNumber(fruits.map(of), of);
  switch (by) {
    case "diameter": return number((f) => f.diameter);
    case "score": return number((f) => f.score);
    case "views": return number((f) => f.views);
    case "side": return byName(fruits, (f) => f.side);
    case "tree": return byName(fruits, (f) => (f.tree ? `tree ${f.tree}` : ""));
    default: return { of: () => APPLE };
  }
}

/** Radius to draw: half the diameter, or the median's half where a fruit's own is not known. */
export function drawnRadii(fruits: Fruit[]): Float32Array {
  const usual = median(fruits.map((f) => f.diameter));
  const fallback = Number.isFinite(usual) ? usual : 0.07;
  return Float32Array.from(fruits, (f) => (Number.isFinite(f.diameter) && f.diameter > 0 ? f.diameter : fallback) / 2);
}
