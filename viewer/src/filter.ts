/** Which fruits are shown: by score, height, place along the row, and tree; points are cut at the same planes. */

import * as three from "three";
import type { SurveyData } from "./contract";
import { find } from "./dom";
import { localised, measured } from "./locale";
import type { Fruit } from "./payload";

export interface Limits {
  score: number;
  low: number;
  high: number;
  start: number;
  end: number;
  tree: number;
}

const STEPS = 200;
/** Shows what lies exactly at a limit, as far as places far from the middle are known in single precision. */
const SLACK = 1e-6;

/** Whether each fruit lies within the limits. */
export function within(fruits: Fruit[], along: readonly number[], limits: Limits): boolean[] {
  return fruits.map((fruit) => {
    const at = fruit.x * along[0]! + fruit.y * along[1]!;
    const slack = SLACK * Math.max(1, Math.abs(fruit.x), Math.abs(fruit.y), Math.abs(fruit.z));
    return fruit.score >= limits.score - SLACK && fruit.z >= limits.low - slack && fruit.z <= limits.high + slack
      && at >= limits.start - slack && at <= limits.end + slack && (limits.tree === 0 || fruit.tree === limits.tree);
  });
}

export class Filter {
  onChange: (shown: boolean[], planes: three.Plane[], limits: Limits) => void = () => {};
  private readonly inputs: Record<"score" | "low" | "high" | "start" | "end", HTMLInputElement>;
  private readonly tree = find<HTMLSelectElement>("#limit-tree");

  constructor(private readonly data: SurveyData, private readonly fruits: Fruit[]) {
    const named = (name: string): HTMLInputElement => find<HTMLInputElement>(`#limit-${name}`);
    this.inputs = { score: named("score"), low: named("low"), high: named("high"), start: named("start"), end: named("end") };
    for (const input of Object.values(this.inputs)) input.addEventListener("input", () => this.changed());
    for (const id of data.trees.ids) this.tree.append(new Option(`tree ${id}`, String(id)));
    find("#limit-tree-label").hidden = data.trees.ids.length === 0;
    this.tree.addEventListener("change", () => this.changed());
    find("#limit-reset").addEventListener("click", () => this.reset());
    this.reset();
  }

  get limits(): Limits {
    const { low, high } = this.data.view;
    const [start, end] = this.data.view.row;
    const share = (name: "low" | "high" | "start" | "end"): number => Number(this.inputs[name].value) / STEPS;
    return {
      score: Number(this.inputs.score.value), low: low + share("low") * (high - low), high: low + share("high") * (high - low),
      start: start + share("start") * (end - start), end: start + share("end") * (end - start), tree: Number(this.tree.value),
    };
  }

  reset(): void {
    for (const [name, input] of Object.entries(this.inputs)) input.value = name === "high" || name === "end" ? String(STEPS) : "0";
    this.tree.value = "0";
    this.changed();
  }

  changed(): void {
    const { limits } = this;
    const shown = within(this.fruits, this.data.view.along, limits);
    const [, , z] = this.data.origin;
    const unit = this.data.unit;
    const far = (value: number): string => `${measured(value, 2)} ${unit}`;
    find("#limit-score-text").textContent = measured(limits.score, 2);
    find("#limit-height-text").textContent = `${far(limits.low + z)} to ${far(limits.high + z)}`;
    const [start] = this.data.view.row;
    find("#limit-row-text").textContent = `${far(limits.start - start)} to ${far(limits.end - start)}`;
    find("#limit-count").textContent = `${localised(shown.filter(Boolean).length, 0)} of ${localised(shown.length, 0)} ${shown.length === 1 ? "fruit" : "fruits"}`;
    this.onChange(shown, this.planes(limits), limits);
  }

  private planes(limits: Limits): three.Plane[] {
    const along = new three.Vector3().fromArray(this.data.view.along);
    const up = new three.Vector3(0, 0, 1);
    const planes: three.Plane[] = [];
    const value = (name: keyof Filter["inputs"]): number => Number(this.inputs[name].value);
    if (value("low") > 0) planes.push(new three.Plane(up.clone(), -limits.low));
    if (value("high") < STEPS) planes.push(new three.Plane(up.clone().negate(), limits.high));
    let [start, end] = [value("start") > 0 ? limits.start : -Infinity, value("end") < STEPS ? limits.end : Infinity];
    if (limits.tree) {
      const places = this.fruits.filter(({ tree }) => tree === limits.tree).map(({ x, y }) => x * along.x + y * along.y);
      const margin = this.data.view.radius / 20;
      [start, end] = [Math.max(start, Math.min(...places) - margin), Math.min(end, Math.max(...places) + margin)];
    }
    if (Number.isFinite(start)) planes.push(new three.Plane(along.clone(), -start));
    if (Number.isFinite(end)) planes.push(new three.Plane(along.clone().negate(), end));
    return planes;
  }
}
