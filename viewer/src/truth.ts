/** Truth beside result: what is true, false, missed and doubled at a score threshold, and P, R and F1. */

import type * as three from "three";
import { Balls } from "./balls";
import type { Rates, TruthData } from "./contract";
import { css, type Colouring, type Rgb } from "./colours";
import { element, find } from "./dom";
import { measured } from "./locale";

const KINDS: { name: string; colour: Rgb; count(rates: Rates): number }[] = [
  { name: "true", colour: [0.16, 0.6, 0.33], count: (rates) => rates.true },
  { name: "false", colour: [0.85, 0.2, 0.16], count: (rates) => rates.false },
  { name: "missed", colour: [0.13, 0.4, 0.85], count: (rates) => rates.missed },
  { name: "doubled", colour: [0.95, 0.6, 0.05], count: (rates) => rates.doubled },
];
const NOT_SCORED: Rgb = [0.55, 0.55, 0.55];
/** What `found` holds, as in Python's contract. */
const COLOUR_OF_CODE: Rgb[] = [NOT_SCORED, KINDS[0]!.colour, KINDS[1]!.colour, KINDS[3]!.colour, NOT_SCORED];

/** The last step whose threshold is not above the score. */
export function stepAt(steps: Rates[], score: number): number {
  let at = 0;
  steps.forEach((step, i) => {
    if (step.threshold <= score + 1e-6) at = i;
  });
  return at;
}

const percent = (value: number | null): string => (value === null ? "–" : measured(value, 3));

export class TruthLayer {
  readonly object: three.Object3D;
  private readonly missed: Balls;
  private step = 0;

  constructor(private readonly truth: TruthData, private readonly fruits: number) {
    this.missed = new Balls(truth.centers);
    this.missed.colour(() => KINDS[2]!.colour);
    this.object = this.missed.object;
    find("#truth").hidden = false;
  }

  /** Show what is so at this score; `shows` says which places are within the section. */
  at(score: number, shows: (x: number, y: number, z: number) => boolean): void {
    this.step = stepAt(this.truth.steps, score);
    const { centers, diameters, missed } = this.truth;
    const first = this.step * diameters.length;
    this.missed.size((i) => (missed[first + i] && shows(centers[3 * i]!, centers[3 * i + 1]!, centers[3 * i + 2]!) ? diameters[i]! / 2 : 0));
    this.tell();
  }

  colouring(): Colouring {
    const of = (index: number): Rgb => COLOUR_OF_CODE[this.truth.found[this.step * this.fruits + index] ?? 0] ?? NOT_SCORED;
    return { of: (fruit) => of(fruit.index), categories: KINDS.map(({ name, colour }) => [name, colour]) };
  }

  private tell(): void {
    const rates = this.truth.steps[this.step];
    if (!rates) return;
    const pairs: [string, string][] = [["P", percent(rates.precision)], ["R", percent(rates.recall)], ["F1", percent(rates.f1)]];
    find("#truth-rates").replaceChildren(...pairs.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
    find("#truth-counts").replaceChildren(...KINDS.map(({ name, colour, count }) => {
      const entry = element("span", `${count(rates)} ${name}`, "category");
      entry.style.setProperty("--colour", css(colour));
      return entry;
    }));
    const whole = this.truth.label === "visible" ? "true fruits that photos show" : "all true fruits";
    find("#truth-note").textContent = `Fruits with a score of at least ${measured(rates.threshold, 2)}, of the whole row, against ${whole}.`;
  }
}
