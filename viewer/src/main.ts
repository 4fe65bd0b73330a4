/** Joins the 3D view and the table of a report: a fruit selected in one is shown in the other. */

import "./style.css";
import { css, rampCss, type ColourBy, type Colouring } from "./colours";
import { decodeFruits, decodeSightings, type Fruit, type Payload } from "./payload";
import { FruitTable } from "./table";
import { View, type Layer, type Side } from "./view";

function find<T extends Element>(selector: string): T {
  const element = document.querySelector<T>(selector);
  if (!element) throw new Error(`The report lacks ${selector}`);
  return element;
}

/** Made with text nodes only: names of files are never read as HTML. */
function element(tag: string, text: string, className = ""): HTMLElement {
  const made = document.createElement(tag);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

function formatted(payload: Payload, by: ColourBy, value: number): string {
  if (by === "diameter") return payload.metric ? `${(1000 * value).toFixed(0)} mm` : value.toPrecision(3);
  return by === "score" ? value.toFixed(2) : value.toFixed(0);
}

function fillLegend(box: HTMLElement, payload: Payload, by: ColourBy, colours: Colouring): void {
  box.replaceChildren();
  if (colours.range) {
    const bar = element("span", "", "ramp");
    bar.style.background = rampCss();
    box.append(element("span", formatted(payload, by, colours.range[0])), bar, element("span", formatted(payload, by, colours.range[1])));
  }
  for (const [name, colour] of (colours.categories ?? []).slice(0, 12)) {
    const entry = element("span", name, "category");
    entry.style.setProperty("--colour", css(colour));
    box.append(entry);
  }
}

function fillCard(card: HTMLElement, fruit: Fruit, row: HTMLTableRowElement | null, photos: string[]): void {
  const close = element("button", "×");
  close.setAttribute("aria-label", "Close");
  close.addEventListener("click", () => card.dispatchEvent(new Event("dismiss")));
  const facts = document.createElement("dl");
  const headings = row?.closest("table")?.tHead?.rows[0]?.cells;
  for (const cell of row ? [...row.cells].slice(1) : []) {
    if (!cell.textContent) continue;
    const label = headings?.[cell.cellIndex]?.dataset.label ?? "";
    facts.append(element("dt", label), element("dd", cell.textContent ?? ""));
  }
  const list = element("ul", "");
  list.append(...photos.map((name) => element("li", name)));
  card.replaceChildren(close, element("h3", `Fruit ${fruit.id}`), facts);
  if (photos.length) card.append(element("p", `Seen in ${photos.length} photo${photos.length > 1 ? "s" : ""}`), list);
  card.hidden = false;
}

function start(): void {
  const payload = JSON.parse(find("#survey-data").textContent ?? "{}") as Payload;
  const fruits = decodeFruits(payload);
  const seenBy = decodeSightings(payload);
  const byId = new Map(fruits.map((fruit) => [fruit.id, fruit]));
  const [box, card, tip] = [find<HTMLElement>("#view"), find<HTMLElement>("#card"), find<HTMLElement>("#tip")];
  let view: View | null = null;

  const select = (id: number | null, from: "view" | "table"): void => {
    const fruit = id === null ? undefined : byId.get(id);
    const cameras = fruit ? seenBy[fruit.index]! : [];
    table.show(fruit ? fruit.id : null);
    view?.select(fruit ? fruit.index : null, cameras, from === "table");
    if (!fruit || !view) card.hidden = true;
    else fillCard(card, fruit, find<HTMLTableElement>("#fruits").querySelector(`tr[data-id="${fruit.id}"]`), cameras.map((i) => payload.cameras.names[i]!));
    if (fruit && view && from === "table") box.scrollIntoView({ block: "nearest", behavior: "smooth" });
  };
  const table = new FruitTable(find("#fruits"), (id) => select(id, "table"));

  try {
    view = new View(box, payload, fruits);
  } catch {
    document.documentElement.classList.add("no-webgl");
    find<HTMLElement>("#no-webgl").hidden = false;
    return;
  }
  const opened = view;
  document.documentElement.classList.add("has-webgl");
  opened.onPick = (index) => select(index === null ? null : fruits[index]!.id, "view");
  opened.onHover = (text, x, y) => {
    tip.hidden = text === null;
    tip.textContent = text;
    tip.style.transform = `translate(${x + 14}px, ${y + 14}px)`;
  };
  card.addEventListener("dismiss", () => select(null, "view"));
  document.addEventListener("keydown", (event) => event.key === "Escape" && select(null, "view"));
  connect(opened, payload, box);
}

function connect(view: View, payload: Payload, box: HTMLElement): void {
  for (const input of document.querySelectorAll<HTMLInputElement>("[data-layer]")) {
    input.addEventListener("change", () => view.show(input.dataset.layer as Layer, input.checked));
    view.show(input.dataset.layer as Layer, input.checked);
  }
  for (const button of document.querySelectorAll<HTMLButtonElement>("[data-look]")) {
    button.addEventListener("click", () => view.look(button.dataset.look as Side));
  }
  const choice = find<HTMLSelectElement>("#colour-by");
  const legend = find<HTMLElement>("#legend");
  const colour = (): void => fillLegend(legend, payload, choice.value as ColourBy, view.colourBy(choice.value as ColourBy));
  choice.addEventListener("change", colour);
  colour();
  const whole = find<HTMLButtonElement>("#whole-screen");
  whole.hidden = !document.fullscreenEnabled;
  whole.addEventListener("click", () => void (document.fullscreenElement ? document.exitFullscreen() : box.requestFullscreen()));
}

start();
