/** How many fruits, and how much of them, fall into packing classes; the classes can be chosen and changed. */

import { element, find } from "./dom";
import { median, type Fruit } from "./payload";

const steps = (from: number, to: number, step: number): number[] => Array.from({ length: Math.round((to - from) / step) + 1 }, (_, i) => from + i * step);

/**
 * Edges in mm. Apples are marketed in the EU from 60 mm on (50 mm if sweet enough), in layers by classes of 5 mm
 * (Delegated Regulation (EU) 2023/2429, annex I, part B).
 */
export const PRESETS: Record<string, number[]> = {
  "apples, 5 mm": [50, ...steps(60, 90, 5)],
  "pears, 5 mm": [45, ...steps(50, 85, 5)],
  "stone fruit, 5 mm": steps(35, 80, 5),
  "citrus, 10 mm": steps(40, 110, 10),
  "cherries, 2 mm": steps(18, 32, 2),
  "apples, 10 mm": steps(50, 90, 10),
};
const MANY = 35;

export interface Class {
  from: number;
  to: number;
  fruits: number;
  /** Grams of those that were weighed. */
  weight: number;
}

/** The classes below, between and above edges in ascending order; `sizes` in the edges' unit, NaN counts nowhere. */
export function classesOf(sizes: number[], weights: number[], edges: number[]): Class[] {
  const limits = [-Infinity, ...edges, Infinity];
  const classes = edges.concat(Infinity).map((to, i) => ({ from: limits[i]!, to, fruits: 0, weight: 0 }));
  sizes.forEach((size, i) => {
    const mine = classes.find(({ from, to }) => size >= from && size < to);
    if (!mine) return;
    mine.fruits += 1;
    mine.weight += Number.isFinite(weights[i]) ? weights[i]! : 0;
  });
  return classes;
}

/** Numbers in what a person typed, in order, each once. */
export function edgesIn(text: string): number[] {
  const found = (text.match(/\d+(?:[.,]\d+)?(?!\d)/g) ?? []).map((word) => Number(word.replace(",", ".")));
  return [...new Set(found.filter((value) => value > 0))].sort((a, b) => a - b);
}

/** Fill the page's table of packing classes, where it has one. */
export function showPacking(fruits: Fruit[]): void {
  const box = document.querySelector<HTMLElement>("#packing");
  if (!box) return;
  const sizes = fruits.map(({ diameter }) => 1000 * diameter);
  const preset = find<HTMLSelectElement>("#packing-preset");
  const typed = find<HTMLInputElement>("#packing-edges");
  preset.append(...Object.keys(PRESETS).map((name) => new Option(name, name)));
  preset.value = median(sizes) < MANY ? "cherries, 2 mm" : "apples, 5 mm";
  const show = (edges: number[]): void => fill(find("#packing-table"), classesOf(sizes, fruits.map(({ weight }) => weight), edges));
  const choose = (): void => {
    const edges = PRESETS[preset.value]!;
    typed.value = edges.join(" ");
    show(edges);
  };
  preset.addEventListener("change", choose);
  typed.addEventListener("input", () => show(edgesIn(typed.value)));
  choose();
  box.hidden = false;
}

function fill(table: HTMLElement, classes: Class[]): void {
  const all = classes.reduce((sum, { fruits }) => sum + fruits, 0);
  const most = Math.max(1, ...classes.map(({ fruits }) => fruits));
  const weighed = classes.some(({ weight }) => weight > 0);
  const share = new Intl.NumberFormat(undefined, { style: "percent", maximumFractionDigits: 1 });
  const count = new Intl.NumberFormat();
  const kilograms = new Intl.NumberFormat(undefined, { maximumFractionDigits: 1, minimumFractionDigits: 1 });
  const line = (cells: string[], tag: "th" | "td"): HTMLElement => {
    const row = element("tr");
    row.append(...cells.map((text) => element(tag, text)));
    return row;
  };
  const head = line(["mm", "fruits", "share", ...(weighed ? ["kg"] : []), ""], "th");
  table.replaceChildren(head, ...classes.map(({ from, to, fruits, weight }) => {
    const name = from === -Infinity ? `below ${count.format(to)}` : to === Infinity ? `${count.format(from)} and more` : `${count.format(from)} to ${count.format(to)}`;
    const row = line([name, count.format(fruits), share.format(all ? fruits / all : 0), ...(weighed ? [kilograms.format(weight / 1000)] : [])], "td");
    const track = element("td", "", "track");
    const bar = element("i");
    bar.style.width = `${(100 * fruits) / most}%`;
    track.append(bar);
    row.append(track);
    return row;
  }));
}
