/** The view's tools: layers, colours, looks, filter, measuring, search, truth, light and dark. */

import * as three from "three";
import type { SurveyData } from "./contract";
import { colouring, css, rampCss, type ColourBy, type Colouring } from "./colours";
import { element, find, say } from "./dom";
import { byChange, byGrowth } from "./earlier";
import { Filter, type Limits } from "./filter";
import { measured, short } from "./locale";
import { Measure } from "./measure";
import type { Look } from "./navigation";
import type { Fruit } from "./payload";
import { TruthLayer } from "./truth";
import type { Layer, View } from "./view";

/** As many entries has the legend. */
const MOST_ENTRIES = 7;

export class Tools {
  onFind: (id: number) => void = () => {};
  onShown: (shown: boolean[]) => void = () => {};
  readonly measure: Measure;
  private readonly filter: Filter;
  private readonly truth: TruthLayer | null;
  private readonly choice = find<HTMLSelectElement>("#colour-by");

  constructor(private readonly view: View, private readonly data: SurveyData, private readonly fruits: Fruit[], private readonly box: HTMLElement) {
    this.measure = new Measure(view, box, data.unit);
    this.filter = new Filter(data, fruits);
    this.truth = data.truth ? new TruthLayer(data.truth, fruits.length) : null;
  }

  start(): void {
    for (const input of document.querySelectorAll<HTMLInputElement>("[data-layer]")) {
      const show = (): void => this.view.show(input.dataset.layer as Layer, input.checked);
      input.addEventListener("change", show);
      show();
    }
    for (const button of document.querySelectorAll<HTMLButtonElement>("[data-look]")) {
      button.addEventListener("click", () => this.view.navigation.look(button.dataset.look as Look));
    }
    if (this.truth) {
      this.view.add(this.truth.object);
      this.choice.prepend(new Option("truth", "truth"));
      this.choice.value = "truth";
    }
    if (this.data.earlier) {
      this.choice.prepend(new Option("growth", "growth"), new Option("change", "change"));
      this.choice.value = "change";
      find("#earlier-layer").hidden = false;
    }
    this.choice.addEventListener("change", () => this.colour());
    this.filter.onChange = (shown, planes, limits) => this.filtered(shown, planes, limits);
    this.filter.changed();
    this.colour();
    this.buttons();
    this.search();
    // What lies over the view begins below the tools, however many lines they take.
    const bar = find(".tools");
    new ResizeObserver(() => this.box.style.setProperty("--below-tools", `${bar.offsetTop + bar.offsetHeight + 8}px`)).observe(bar);
  }

  private colour(): void {
    const by = this.choice.value as ColourBy;
    const colours = this.view.colour(this.colouring(by));
    // The truth's panel is its own legend.
    fillLegend(find("#legend"), this.data, by, by === "truth" ? { of: colours.of } : colours);
    if (this.truth) this.truth.object.visible = by === "truth";
  }

  private colouring(by: ColourBy): Colouring {
    const { earlier } = this.data;
    if (by === "truth" && this.truth) return this.truth.colouring();
    if (by === "change" && earlier) return byChange(earlier);
    if (by === "growth" && earlier) return byGrowth(earlier);
    return colouring(by, this.fruits);
  }

  private filtered(shown: boolean[], planes: three.Plane[], limits: Limits): void {
    this.view.showFruits(shown);
    this.view.clip(planes);
    this.onShown(shown);
    if (!this.truth) return;
    this.truth.at(limits.score, (x, y, z) => planes.every((plane) => plane.distanceToPoint(new three.Vector3(x, y, z)) >= 0));
    if (this.choice.value === "truth") this.colour();
  }

  private buttons(): void {
    const toggle = (selector: string, act: () => boolean): void => {
      const button = find<HTMLButtonElement>(selector);
      button.addEventListener("click", () => button.setAttribute("aria-pressed", String(act())));
    };
    const panel = find("#limits");
    toggle("#tool-filter", () => !(panel.hidden = !panel.hidden));
    // With the truth, the score's slider is what one looks for.
    if (this.truth) find("#tool-filter").click();
    toggle("#tool-measure", () => {
      this.measure.toggle();
      return this.measure.on;
    });
    toggle("#tool-fly", () => this.view.navigation.flyAlong());
    const fly = find("#tool-fly");
    this.box.addEventListener("drawn", () => {
      if (!this.view.navigation.flies) fly.setAttribute("aria-pressed", "false");
    });
    find("#tool-light").addEventListener("click", () => {
      const root = document.documentElement;
      const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
      root.dataset.theme = dark ? "light" : "dark";
      this.view.paper();
    });
    const whole = find<HTMLButtonElement>("#whole-screen");
    whole.hidden = !document.fullscreenEnabled;
    whole.addEventListener("click", () => void (document.fullscreenElement ? document.exitFullscreen() : this.box.requestFullscreen()));
  }

  private search(): void {
    const form = find<HTMLFormElement>("#find");
    const input = find<HTMLInputElement>("#find-id");
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const id = Number(input.value);
      const known = this.data.fruits.ids.includes(id);
      input.setCustomValidity(known ? "" : `There is no fruit ${input.value}`);
      if (known) this.onFind(id);
      else {
        input.reportValidity();
        say(`There is no fruit ${input.value}`);
      }
    });
    input.addEventListener("input", () => input.setCustomValidity(""));
  }
}

function formatted(data: SurveyData, by: ColourBy, value: number): string {
  if (by === "growth") return data.metric ? `${measured(1000 * value, 1)} mm` : short(value, 3);
  if (by === "diameter") return data.metric ? `${measured(1000 * value, 0)} mm` : short(value, 3);
  return measured(value, by === "score" ? 2 : 0);
}

function fillLegend(box: HTMLElement, data: SurveyData, by: ColourBy, colours: Colouring): void {
  box.replaceChildren();
  if (colours.range) {
    const bar = element("span", "", "ramp");
    bar.style.background = rampCss();
    box.append(element("span", formatted(data, by, colours.range[0])), bar, element("span", formatted(data, by, colours.range[1])));
  }
  const categories = colours.categories ?? [];
  for (const [name, colour] of categories.slice(0, MOST_ENTRIES)) {
    const entry = element("span", name, "category");
    entry.style.setProperty("--colour", css(colour));
    box.append(entry);
  }
  if (categories.length > MOST_ENTRIES) box.append(element("span", `and ${categories.length - MOST_ENTRIES} more; colours come again`));
}
