/** What is shown survives that the page is loaded again with corrected fruits. */

import type { SurveyData } from "./contract";
import { find } from "./dom";
import type { View } from "./view";

/** Where a photo shows a fruit: the middle of its crop and half the crop's width, pixels. */
export interface Sight {
  photo: string;
  x: number;
  y: number;
  half: number;
}

/** What is told and selected after a correction; where photos arrive and numbers change, by what a photo shows. */
export interface Told {
  message: string;
  fruit: number;
  fly: boolean;
  sight?: Sight | undefined;
}

interface Kept extends Told {
  title: string;
  focus: Focus;
  theme: string;
  /** Of all inputs of the view, in the page's order. */
  inputs: (string | boolean)[];
  filtering: boolean;
  sorted: { column: number; order: string } | null;
  /** Where one stands and looks, in the world; null where one looks through a camera. */
  pose: { eye: number[]; target: number[] } | null;
}

/** Where the keyboard is: at an element, by its id, or in the table, by the place of its row, from 0. */
export interface Focus {
  id: string;
  row: number;
}

const KEY = "pomona-correcting";
const INPUTS = "#view .tools input, #view .tools select, #limits input, #limits select";
const pressed = (selector: string): boolean => find(selector).getAttribute("aria-pressed") === "true";

export function remember(data: SurveyData, view: View | null, told: Told): void {
  const headings = [...document.querySelectorAll<HTMLTableCellElement>("#fruits th")];
  const column = headings.findIndex((heading) => heading.ariaSort);
  const away = (place: { toArray(): number[] }): number[] => place.toArray().map((value, axis) => value + data.origin[axis]!);
  const kept: Kept = {
    ...told,
    title: data.title,
    focus: focused(),
    theme: document.documentElement.dataset.theme ?? "",
    inputs: inputs().map((input) => (input instanceof HTMLInputElement && input.type === "checkbox" ? input.checked : input.value)),
    filtering: pressed("#tool-filter"),
    sorted: column < 0 ? null : { column, order: headings[column]!.ariaSort! },
    pose: view && !view.navigation.through ? { eye: away(view.navigation.camera.position), target: away(view.navigation.controls.target) } : null,
  };
  sessionStorage.setItem(KEY, JSON.stringify(kept));
}

/** Show what was remembered, once; null where nothing was. */
export function forget(data: SurveyData, view: View | null): (Told & { focus: Focus }) | null {
  const text = sessionStorage.getItem(KEY);
  sessionStorage.removeItem(KEY);
  const kept = text ? (JSON.parse(text) as Kept) : null;
  if (!kept || kept.title !== data.title) return null;
  if (kept.theme) document.documentElement.dataset.theme = kept.theme;
  inputs().forEach((input, i) => {
    const value = kept.inputs[i];
    if (input instanceof HTMLInputElement && typeof value === "boolean") input.checked = value;
    else if (typeof value === "string") input.value = value;
    for (const name of ["input", "change"]) input.dispatchEvent(new Event(name, { bubbles: true }));
  });
  if (pressed("#tool-filter") !== kept.filtering) find("#tool-filter").click();
  const heading = kept.sorted && document.querySelectorAll<HTMLTableCellElement>("#fruits th")[kept.sorted.column];
  for (let click = 0; heading && heading.ariaSort !== kept.sorted!.order && click < 2; click++) heading.querySelector("button")?.click();
  if (view && kept.pose) {
    const here = (place: number[]): [number, number, number] => place.map((value, axis) => value - data.origin[axis]!) as [number, number, number];
    view.navigation.stand(here(kept.pose.eye), here(kept.pose.target));
    view.paper();
  }
  return kept;
}

function focused(): Focus {
  const at = document.activeElement;
  const row = Number(at?.closest("#fruits tr")?.getAttribute("aria-rowindex") ?? 1) - 2;
  return { id: at?.closest("dialog") ? "correct-add" : (at?.id ?? ""), row };
}

function inputs(): (HTMLInputElement | HTMLSelectElement)[] {
  return [...document.querySelectorAll<HTMLInputElement | HTMLSelectElement>(INPUTS)];
}
