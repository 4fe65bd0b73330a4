/** The table of fruits: sorted by a click on a heading, one row selected; of many rows only those in sight are in the page. */

import { button, element } from "./dom";
import type { SurveyData } from "./contract";
import { localised, measured } from "./locale";
import type { Fruit } from "./payload";

export type Order = "ascending" | "descending";

/** A heading with its unit, and what a fruit has there: NaN or "" where it was not measured. */
export interface Column {
  label: string;
  unit: string;
  value(fruit: Fruit): number | string;
  digits: number;
}

/** So many rows may all be in the page; of more, those in sight and some above and below. */
const FEW = 200;
const BEYOND = 20;
/** As many are printed: more would make hundreds of pages. */
const PRINTED = 3000;
const WIDEST = 12;

/** Those columns that have anything to tell. */
export function columnsOf(data: Pick<SurveyData, "metric" | "origin" | "unit">, fruits: Fruit[]): Column[] {
  const [length, size, factor] = data.metric ? ["m", "mm", 1000] : ["", "", 1] as const;
  const digits = data.metric ? 1 : 4;
  const columns: Column[] = [{ label: "id", unit: "", value: ({ id }) => id, digits: 0 }];
  (["x", "y", "z"] as const).forEach((axis, i) => columns.push({ label: axis, unit: length, value: (fruit) => fruit[axis] + data.origin[i]!, digits: 3 }));
  columns.push({ label: "diameter", unit: size, value: ({ diameter }) => factor * diameter, digits });
  const where = (known: (fruit: Fruit) => boolean, column: Column): unknown => fruits.some(known) && columns.push(column);
  where(({ diameterSd }) => Number.isFinite(diameterSd), { label: "±", unit: size, value: ({ diameterSd }) => factor * diameterSd, digits });
  columns.push({ label: "score", unit: "", value: ({ score }) => score, digits: 2 }, { label: "photos", unit: "", value: ({ views }) => views, digits: 0 });
  where(({ visibility }) => Number.isFinite(visibility), { label: "visible", unit: "", value: ({ visibility }) => visibility, digits: 2 });
  where(({ weight }) => Number.isFinite(weight), { label: "weight", unit: "g", value: ({ weight }) => weight, digits: 0 });
  where(({ tree }) => tree > 0, { label: "tree", unit: "", value: ({ tree }) => tree || NaN, digits: 0 });
  where(({ side }) => side !== "", { label: "side", unit: "", value: ({ side }) => side, digits: 0 });
  where(({ reason }) => reason !== "", { label: "not measured because", unit: "", value: ({ reason }) => reason, digits: 0 });
  return columns;
}

/** Compare two cells; what was not measured comes last in either order. */
export function compared(a: number | string, b: number | string, order: Order): number {
  const sign = order === "ascending" ? 1 : -1;
  if (typeof a === "string" || typeof b === "string") return sign * String(a).localeCompare(String(b), undefined, { numeric: true });
  if (Number.isNaN(a) || Number.isNaN(b)) return Number(Number.isNaN(a)) - Number(Number.isNaN(b));
  return sign * (a - b);
}

/** First row and the one after the last that have to be in the page. */
export function rowsInSight(top: number, height: number, rowHeight: number, count: number): [number, number] {
  if (count <= FEW) return [0, count];
  const first = Math.max(0, Math.min(Math.floor(top / rowHeight) - BEYOND, count - BEYOND));
  return [first, Math.min(count, Math.ceil((top + height) / rowHeight) + BEYOND)];
}

export class FruitTable {
  private readonly columns: Column[];
  private readonly box: HTMLElement;
  private readonly body = element("tbody");
  private readonly headings: HTMLTableCellElement[];
  /** All fruits in the order of the table, and those of them that are shown. */
  private sorted: Fruit[];
  private rows: Fruit[];
  private shows: (fruit: Fruit) => boolean = () => true;
  private readonly made = new Map<Fruit, HTMLTableRowElement>();
  private selected: Fruit | null = null;
  /** The row that the Tab key reaches, and from which the arrows go on. */
  private at = 0;
  private rowHeight = 29;
  private onPaper = false;

  constructor(private readonly table: HTMLTableElement, data: SurveyData, fruits: Fruit[], private readonly onSelect: (id: number) => void) {
    this.box = table.parentElement!;
    this.sorted = [...fruits];
    this.rows = this.sorted;
    this.columns = columnsOf(data, fruits);
    this.headings = this.columns.map((column) => this.heading(column, fruits));
    const head = element("thead");
    const line = element("tr");
    line.setAttribute("aria-rowindex", "1");
    line.append(...this.headings);
    head.append(line);
    table.append(head, this.body);
    table.hidden = fruits.length === 0;
    this.body.addEventListener("click", (event) => {
      const row = (event.target as Element).closest("tr");
      if (row?.dataset.id) this.onSelect(Number(row.dataset.id));
    });
    this.box.addEventListener("keydown", (event) => this.key(event));
    this.box.addEventListener("scroll", () => this.draw(), { passive: true });
    new ResizeObserver(() => this.draw()).observe(this.box);
    for (const event of ["beforeprint", "afterprint"] as const) {
      window.addEventListener(event, () => {
        this.onPaper = event === "beforeprint";
        this.draw();
      });
    }
    this.draw();
    this.rowHeight = this.body.rows[0]?.offsetHeight || this.rowHeight;
    this.draw();
  }

  /** Leave out the rows of fruits that are not shown. */
  filter(shows: (fruit: Fruit) => boolean): void {
    this.shows = shows;
    this.arrange();
  }

  sortBy(column: number): void {
    const heading = this.headings[column]!;
    const order: Order = heading.ariaSort === "ascending" ? "descending" : "ascending";
    for (const other of this.headings) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", order);
    const { value } = this.columns[column]!;
    this.sorted.sort((a, b) => compared(value(a), value(b), order));
    this.arrange();
  }

  /** Mark a fruit's row and bring it into sight within the table, without moving the page. */
  show(fruit: Fruit | null): void {
    if (this.selected) this.made.get(this.selected)?.removeAttribute("aria-current");
    this.selected = fruit;
    const at = fruit ? this.rows.indexOf(fruit) : -1;
    if (at < 0) return;
    this.at = at;
    this.bring(at);
  }

  /** Put the keyboard into a row, by its place in the table from 0; in the last one where there are fewer. */
  focus(at: number): void {
    if (!this.rows.length) return;
    this.at = Math.min(at, this.rows.length - 1);
    this.bring(this.at);
    this.made.get(this.rows[this.at]!)?.querySelector("button")?.focus({ preventScroll: true });
  }

  private heading(column: Column, fruits: Fruit[]): HTMLTableCellElement {
    const cell = element("th");
    const text = typeof column.value(fruits[0] ?? ({} as Fruit)) === "string";
    cell.scope = "col";
    cell.dataset.kind = text ? "text" : "number";
    const made = button(column.label, "", () => this.sortBy(this.headings.indexOf(cell)));
    if (column.unit) made.append(" ", element("small", column.unit));
    cell.append(made);
    // As wide as its longest text, whichever rows are in the page.
    const longest = fruits.reduce((most, fruit) => Math.max(most, written(column, fruit).length), 0);
    cell.style.minWidth = `calc(${Math.min(longest, WIDEST)}ch + 8px)`;
    return cell;
  }

  private arrange(): void {
    const focused = this.rows[this.at];
    this.rows = this.sorted.filter(this.shows);
    this.at = Math.max(0, this.rows.indexOf(this.selected ?? focused!));
    this.body.replaceChildren();
    this.draw();
  }

  /**
   * Put the rows that are in sight into the page, and empty ones as high as what is above and below.
   *
   * On paper nothing scrolls: a line says there how many rows are left out.
   */
  private draw(): void {
    const count = this.rows.length;
    const [first, end] = this.onPaper ? [0, Math.min(count, PRINTED)] : rowsInSight(this.box.scrollTop, this.box.clientHeight, this.rowHeight, count);
    const wanted = this.rows.slice(first, end);
    const kept = new Set(wanted);
    // The keyboard stays in the table when its row leaves the page; before that, as the browser measures the page here.
    const focused = document.activeElement?.closest("tr");
    if (focused && this.body.contains(focused) && !wanted.some((fruit) => this.made.get(fruit) === focused)) this.box.focus({ preventScroll: true });
    for (const [fruit, row] of this.made) {
      if (kept.has(fruit)) continue;
      row.remove();
      this.made.delete(fruit);
    }
    const lines = wanted.map((fruit, i) => this.row(fruit, first + i));
    // Rows that stay are not moved, as they would lose the focus.
    const present = [...this.body.children];
    const left = count - end;
    const below = this.onPaper ? leftOut(left, this.columns.length) : space(left * this.rowHeight);
    const all = [space(first * this.rowHeight), ...lines, below].filter((row) => row !== null);
    for (const row of present) if (!all.includes(row as HTMLTableRowElement)) row.remove();
    all.forEach((row, i) => this.body.children[i] !== row && this.body.insertBefore(row, this.body.children[i] ?? null));
    this.table.setAttribute("aria-rowcount", String(count + 1));
  }

  private row(fruit: Fruit, index: number): HTMLTableRowElement {
    const row = this.made.get(fruit) ?? this.newRow(fruit);
    row.setAttribute("aria-rowindex", String(index + 2));
    row.toggleAttribute("aria-current", false);
    if (fruit === this.selected) row.setAttribute("aria-current", "true");
    // One row alone is a stop of the Tab key; arrows go on from there.
    row.querySelector("button")!.tabIndex = index === this.at ? 0 : -1;
    return row;
  }

  private newRow(fruit: Fruit): HTMLTableRowElement {
    const row = element("tr");
    row.dataset.id = String(fruit.id);
    for (const [i, column] of this.columns.entries()) {
      const text = written(column, fruit);
      const cell = element("td", i ? text : "");
      if (!i) cell.append(button(text, `Fruit ${text}`, () => {}));
      if (this.headings[i]!.dataset.kind === "text") {
        cell.className = "text";
        if (text.length > WIDEST) cell.title = text;
      } else if (text === "–") {
        cell.className = "none";
        cell.title = fruit.reason || "not measured";
      }
      row.append(cell);
    }
    this.made.set(fruit, row);
    return row;
  }

  /** Scroll the table, where needed, so that a row is in sight. */
  private bring(at: number): void {
    const head = this.table.tHead!.offsetHeight;
    const top = at * this.rowHeight;
    const above = top < this.box.scrollTop;
    const below = top + this.rowHeight > this.box.scrollTop + this.box.clientHeight - head;
    if (above || below) this.box.scrollTop = top - (this.box.clientHeight - head) / 2;
    this.draw();
  }

  private key(event: KeyboardEvent): void {
    const step: Record<string, number> = { ArrowDown: this.at + 1, ArrowUp: this.at - 1, Home: 0, End: this.rows.length - 1 };
    const to = step[event.key];
    if (to === undefined || event.ctrlKey || event.metaKey || event.altKey || !this.rows.length) return;
    event.preventDefault();
    // The first arrow into a table of which nothing is selected selects the row that has the focus.
    const at = !this.selected && event.target === this.box ? this.at : Math.min(Math.max(to, 0), this.rows.length - 1);
    const fruit = this.rows[at]!;
    this.onSelect(fruit.id);
    this.made.get(fruit)?.querySelector("button")?.focus({ preventScroll: true });
  }
}

function written(column: Column, fruit: Fruit): string {
  const value = column.value(fruit);
  if (typeof value === "string") return value;
  return Number.isNaN(value) ? "–" : measured(value, column.digits);
}

/** A row that stands for those that are not in the page. */
function space(height: number): HTMLTableRowElement | null {
  if (height <= 0) return null;
  const row = element("tr", "", "space");
  row.setAttribute("aria-hidden", "true");
  const cell = element("td");
  cell.style.height = `${height}px`;
  row.append(cell);
  return row;
}

/** The last row on paper, which says what is not there. */
function leftOut(fruits: number, columns: number): HTMLTableRowElement | null {
  if (fruits <= 0) return null;
  const row = element("tr");
  const cell = element("td", `${localised(fruits, 0)} more fruits are not printed: fruits.csv in the survey's folder has all.`, "text");
  cell.colSpan = columns;
  row.append(cell);
  return row;
}
