/** How many fruits, and how much of them, fall into packing classes; the classes can be chosen and changed. */

import { element, find } from "./dom";
import type { Fruit } from "./payload";

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
  const show = (edges: number[]): void => fill(find("#packing-table"), classesOf(sizes, fruits.map(({ weight }) => weight), edges));
  const choose = (): void => {
    typed.value = preset.selectedOptions[0]!.dataset.edges!;
    show(edgesIn(typed.value));
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
