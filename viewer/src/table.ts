/** The table of fruits: sorting by a click on a heading, and one selected row. Python has written the rows. */

export type Order = "ascending" | "descending";

/** Compare two cells' texts; what is not a number (a dash: not measured) comes last in either order. */
export function compareCells(a: string, b: string, numeric: boolean, order: Order): number {
  const sign = order === "ascending" ? 1 : -1;
  if (!numeric) return sign * a.localeCompare(b, undefined, { numeric: true });
  const [x, y] = [parse(a), parse(b)];
  if (Number.isNaN(x) || Number.isNaN(y)) return Number(Number.isNaN(x)) - Number(Number.isNaN(y));
  return sign * (x - y);
}

const parse = (text: string): number => (text.trim() === "" ? NaN : Number(text));

export class FruitTable {
  private readonly rows = new Map<number, HTMLTableRowElement>();
  private readonly box: HTMLElement;
  private selected: HTMLTableRowElement | null = null;

  constructor(private readonly table: HTMLTableElement, private readonly onSelect: (id: number) => void) {
    this.box = table.parentElement!;
    for (const row of table.tBodies[0]!.rows) {
      if (row.dataset.id) this.rows.set(Number(row.dataset.id), row);
    }
    table.tBodies[0]!.addEventListener("click", (event) => {
      const row = (event.target as Element).closest("tr");
      if (row?.dataset.id) this.onSelect(Number(row.dataset.id));
    });
    for (const heading of table.tHead!.rows[0]!.cells) {
      heading.querySelector("button")?.addEventListener("click", () => this.sortBy(heading));
    }
    this.box.addEventListener("keydown", (event) => this.step(event));
    this.reach(this.table.tBodies[0]!.rows[0] ?? null);
  }

  /** Leave out the rows of fruits that are not shown. */
  filter(shows: (id: number) => boolean): void {
    for (const [id, row] of this.rows) row.hidden = !shows(id);
    this.reach(this.selected && !this.selected.hidden ? this.selected : this.next(this.table.tBodies[0]!.rows[0] ?? null, true));
  }

  sortBy(heading: HTMLTableCellElement): void {
    const order: Order = heading.ariaSort === "ascending" ? "descending" : "ascending";
    for (const other of this.table.tHead!.rows[0]!.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", order);
    const column = heading.cellIndex;
    const numeric = heading.dataset.kind === "number";
    const keyed = [...this.rows.values()].map((row) => ({ row, text: row.cells[column]?.textContent ?? "" }));
    keyed.sort((a, b) => compareCells(a.text, b.text, numeric, order));
    this.table.tBodies[0]!.append(...keyed.map(({ row }) => row));
  }

  /** Mark a fruit's row and bring it into sight within the table, without moving the page. */
  show(id: number | null): void {
    this.selected?.removeAttribute("aria-current");
    this.selected = id === null ? null : (this.rows.get(id) ?? null);
    if (!this.selected) return;
    this.selected.setAttribute("aria-current", "true");
    this.reach(this.selected);
    const row = this.selected;
    const head = this.table.tHead!.offsetHeight;
    const above = row.offsetTop - head < this.box.scrollTop;
    const below = row.offsetTop + row.offsetHeight > this.box.scrollTop + this.box.clientHeight;
    if (above || below) this.box.scrollTop = row.offsetTop - head - (this.box.clientHeight - head) / 2;
  }

  /** One row alone is a stop of the Tab key; arrows go on from there. */
  private reach(row: HTMLTableRowElement | null): void {
    for (const other of this.table.tBodies[0]!.querySelectorAll<HTMLElement>('button[tabindex="0"]')) other.tabIndex = -1;
    const button = row?.querySelector<HTMLElement>("button");
    if (button) button.tabIndex = 0;
  }

  private next(row: Element | null, down: boolean): HTMLTableRowElement | null {
    let at = row;
    while (at instanceof HTMLTableRowElement && at.hidden) at = down ? at.nextElementSibling : at.previousElementSibling;
    return at instanceof HTMLTableRowElement ? at : null;
  }

  private step(event: KeyboardEvent): void {
    if (event.key !== "ArrowDown" && event.key !== "ArrowUp") return;
    const down = event.key === "ArrowDown";
    const focused = (event.target as Element).closest("tr");
    const from = focused?.dataset.id ? focused : this.selected;
    const first = this.table.tBodies[0]!.rows[0] ?? null;
    const next = this.next(from ? (down ? from.nextElementSibling : from.previousElementSibling) : first, down);
    if (!next?.dataset.id) return;
    event.preventDefault();
    this.onSelect(Number(next.dataset.id));
    next.querySelector<HTMLElement>("button")?.focus({ preventScroll: true });
  }
}
