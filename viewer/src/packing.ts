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

/** How many fruits of the whole crop are smaller than each of the edges, in mm, and what these weigh. */
export interface Crop {
  edges: number[];
  fruits: number[];
  kg: number[];
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

/** How many of the whole crop, and how many kilograms of it, are below, between and above edges in ascending order. */
export function cropClasses(crop: Crop, edges: number[]): { fruits: number; kg: number }[] {
  const between = (column: number[]): number[] => {
    const below = [0, ...edges.map((edge) => interpolated(edge, crop.edges, column)), column[column.length - 1]!];
    return below.slice(1).map((value, i) => value - below[i]!);
  };
  const kilograms = between(crop.kg);
  return between(crop.fruits).map((fruits, i) => ({ fruits, kg: kilograms[i]! }));
}

function interpolated(at: number, xs: number[], ys: number[]): number {
  const above = xs.findIndex((x) => x > at);
  if (above === 0) return ys[0]!;
  if (above < 0) return ys[ys.length - 1]!;
  const share = (at - xs[above - 1]!) / (xs[above]! - xs[above - 1]!);
  return ys[above - 1]! + share * (ys[above]! - ys[above - 1]!);
}

/**
 * Numbers in what a person typed, in order, each once.
 *
 * A comma within a word is a decimal mark, as in 72,5, unless the word is a list in ascending order, such as 60,65,70.
 */
export function edgesIn(text: string): number[] {
  const found = (text.match(/\d+(?:[.,]\d+)*/g) ?? []).flatMap((word) => {
    const list = word.split(",").map(Number);
    if (list.every((value, i) => value > (list[i - 1] ?? -1))) return list;
    return (word.match(/\d+(?:[.,]\d+)?/g) ?? []).map((number) => Number(number.replace(",", ".")));
  });
  return [...new Set(found.filter((value) => value > 0))].sort((a, b) => a - b);
}

/** Metres in millimetres, to a thousandth: in single precision 0.065 is a little less, and would be below an edge at 65. */
export function millimetres(metres: number): number {
  return Math.round(1e6 * metres) / 1000;
}

/** Fill the page's table of packing classes, where it has one. */
export function showPacking(fruits: Fruit[]): void {
  const box = document.querySelector<HTMLElement>("#packing");
  if (!box) return;
  const sizes = fruits.map(({ diameter }) => millimetres(diameter));
  const preset = find<HTMLSelectElement>("#packing-preset");
  const typed = find<HTMLInputElement>("#packing-edges");
  const crop = box.dataset.crop ? (JSON.parse(box.dataset.crop) as Crop) : null;
  const show = (edges: number[]): void => {
    const measured = classesOf(sizes, fruits.map(({ weight }) => weight), edges);
    fill(find("#packing-table"), measured, crop && cropClasses(crop, edges));
  };
  const choose = (): void => {
    typed.value = preset.selectedOptions[0]!.dataset.edges!;
    show(edgesIn(typed.value));
  };
  preset.addEventListener("change", choose);
  typed.addEventListener("input", () => show(edgesIn(typed.value)));
  choose();
  box.hidden = false;
}

function fill(table: HTMLElement, classes: Class[], crop: { fruits: number; kg: number }[] | null): void {
  const counts = crop ? crop.map(({ fruits }) => fruits) : classes.map(({ fruits }) => fruits);
  const weights = crop ? crop.map(({ kg }) => kg) : classes.map(({ weight }) => weight / 1000);
  const all = counts.reduce((sum, fruits) => sum + fruits, 0);
  const most = Math.max(1e-9, ...counts);
  const weighed = weights.some((weight) => weight > 0);
  const share = new Intl.NumberFormat(undefined, { style: "percent", minimumFractionDigits: 1, maximumFractionDigits: 1 });
  const count = new Intl.NumberFormat();
  const kilograms = new Intl.NumberFormat(undefined, { maximumFractionDigits: 1, minimumFractionDigits: 1 });
  const line = (cells: string[], tag: "th" | "td"): HTMLElement => {
    const row = element("tr");
    row.append(...cells.map((text) => element(tag, text)));
    return row;
  };
  const head = line(["mm", crop ? "measured" : "fruits", "share", ...(weighed ? ["kg"] : []), ""], "th");
  table.replaceChildren(head, ...classes.map(({ from, to, fruits }, i) => {
    const name = from === -Infinity ? `below ${count.format(to)}` : to === Infinity ? `${count.format(from)} and more` : `${count.format(from)} to ${count.format(to)}`;
    const row = line([name, count.format(fruits), share.format(all ? counts[i]! / all : 0), ...(weighed ? [kilograms.format(weights[i]!)] : [])], "td");
    const track = element("td", "", "track");
    const bar = element("i");
    bar.style.width = `${(100 * counts[i]!) / most}%`;
    track.append(bar);
    row.append(track);
    return row;
  }));
}
