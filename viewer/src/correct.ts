/** Correcting fruits: the panel with what can be done, the requests to the server, and what it answers. */

import { Refused, whyOf } from "./columns";
import type { CorrectionAnswer, CorrectionKind, CorrectionRequest, CorrectionState, SurveyData } from "./contract";
import { Marking, type Marked } from "./correct-marks";
import { forget, remember, type Focus } from "./correct-memory";
import { element, find, say } from "./dom";
import type { Fruit, Photo, Sighting } from "./payload";
import type { PhotoWindow } from "./photo";
import type { View } from "./view";

/** What the panel asks of the page. */
export interface Correctable {
  data: SurveyData;
  photos: Photo[];
  photoWindow: PhotoWindow;
  view: View | null;
  selected(): Fruit | null;
  sightings(): Sighting[];
  select(id: number, fly: boolean): void;
  focusRow(at: number): void;
}

type Change = Partial<Omit<CorrectionRequest, "kind" | "revision">>;

export class Correcting {
  private readonly panel = find("#correct");
  private readonly tool = find<HTMLButtonElement>("#tool-correct");
  private readonly text = find("#correct-text");
  private readonly tree = find<HTMLInputElement>("#correct-tree");
  private readonly marking: Marking;
  /** The fruit to be merged with the next one that is selected. */
  private first: Fruit | null = null;
  private busy = false;

  constructor(private readonly page: Correctable, private readonly state: CorrectionState) {
    this.marking = new Marking(page.photoWindow, page.photos, page.data, (marked) => this.marked(marked));
    this.tool.hidden = false;
    this.tool.addEventListener("click", () => this.open(Boolean(this.panel.hidden)));
    const acts: [string, () => void][] = [
      ["#correct-delete", () => this.ofSelected("delete")], ["#correct-split", () => this.split()], ["#correct-merge", () => this.merge()],
      ["#correct-add", () => this.add()], ["#correct-undo", () => void this.ask("undo")], ["#correct-redo", () => void this.ask("redo")],
    ];
    for (const [selector, act] of acts) find(selector).addEventListener("click", act);
    find("#correct-move").addEventListener("submit", (event) => {
      event.preventDefault();
      this.ofSelected("move", { tree: Number(this.tree.value) });
    });
    const inPhoto = find<HTMLButtonElement>("#photo-add");
    inPhoto.hidden = state.note !== "";
    inPhoto.addEventListener("click", () => this.marking.start({ kind: "add", fruits: [] }, page.photoWindow.photo));
    document.addEventListener("keydown", (event) => this.key(event));
    this.list();
    this.selected(page.selected());
  }

  /** Show again what was shown before the page was loaded again for a correction. */
  restore(): void {
    const { photos: _, view, data } = this.page;
    const kept = forget(data, view);
    if (!kept) return;
    this.open(true);
    if (kept.fruit && data.fruits.ids.includes(kept.fruit)) this.page.select(kept.fruit, kept.fly);
    this.tell(kept.message);
    this.focus(kept.focus);
  }

  /** Go on where the keyboard was: what was pressed may be out of use now, and a fruit's row be that of the next one. */
  private focus({ id, row }: Focus): void {
    if (row >= 0) this.page.focusRow(row);
    if (!id) return;
    document.getElementById(id)?.focus();
    if (document.activeElement?.id !== id) this.text.focus();
  }

  /** Another fruit was selected, or none. */
  selected(fruit: Fruit | null): void {
    if (this.first && fruit && fruit.id !== this.first.id) {
      const fruits = [this.first.id, fruit.id];
      this.first = null;
      void this.ask("merge", { fruits });
    }
    const can = fruit !== null && !this.state.note;
    for (const name of ["delete", "split", "merge", "move-button"]) find<HTMLButtonElement>(`#correct-${name}`).disabled = !can;
    this.tree.disabled = !can;
    this.tree.value = fruit?.tree ? String(fruit.tree) : "";
    const how = fruit ? (this.state.fruits[fruit.index] ?? "") : "";
    const named = fruit ? `Fruit ${fruit.id}${how ? `, ${how} by hand` : ""}` : "Choose a fruit: click it, or find it by its number.";
    if (!this.first) this.text.textContent = this.state.note || named;
  }

  private open(open: boolean): void {
    this.panel.hidden = !open;
    this.tool.setAttribute("aria-pressed", String(open));
  }

  /** What was done and undone, and what no longer matches. */
  private list(): void {
    const { done, undone, lost, note } = this.state;
    const undo = find<HTMLButtonElement>("#correct-undo");
    const redo = find<HTMLButtonElement>("#correct-redo");
    undo.disabled = !done.length || note !== "";
    redo.disabled = !undone.length || note !== "";
    undo.title = done.length ? `Undo: ${done[done.length - 1]} (Ctrl+Z)` : "";
    redo.title = undone.length ? `Redo: ${undone[undone.length - 1]} (Ctrl+Shift+Z)` : "";
    find<HTMLButtonElement>("#correct-add").disabled = note !== "";
    find("#correct-log").hidden = !done.length;
    find("#correct-count").textContent = `${done.length} correction${done.length === 1 ? "" : "s"}`;
    find("#correct-list").replaceChildren(...done.map((text) => element("li", text)));
    find("#correct-lost").replaceChildren(...lost.map((text) => element("p", text)));
  }

  private ofSelected(kind: CorrectionKind, change: Change = {}): void {
    const fruit = this.page.selected();
    if (fruit) void this.ask(kind, { ...change, fruits: [fruit.id] });
  }

  private merge(): void {
    if (this.first) {
      this.first = null;
      this.selected(this.page.selected());
      this.tell("Nothing is merged.");
      return;
    }
    this.first = this.page.selected();
    if (this.first) this.tell(`Now choose the fruit that is the same as fruit ${this.first.id}: click it, or find it by its number. Escape leaves both as they are.`);
  }

  private split(): void {
    const fruit = this.page.selected();
    if (!fruit) return;
    const photo = this.page.sightings()[0];
    this.marking.start({ kind: "split", fruits: [fruit.id] }, photo?.photo ?? this.nearest(), photo?.box);
  }

  private add(): void {
    this.marking.start({ kind: "add", fruits: [] }, this.page.view?.navigation.through?.index ?? this.page.sightings()[0]?.photo ?? this.nearest());
  }

  /** The photo that was taken nearest to where one stands. */
  private nearest(): number {
    const at = this.page.view?.navigation.camera.position;
    if (!at) return 0;
    const away = this.page.photos.map(({ center: [x, y, z] }) => Math.hypot(x - at.x, y - at.y, z - at.z));
    return away.indexOf(Math.min(...away));
  }

  private marked({ kind, fruits, marks, size }: Marked): Promise<string | null> {
    return this.ask(kind, { fruits, marks, size });
  }

  private key(event: KeyboardEvent): void {
    const writing = event.target instanceof HTMLInputElement && ["text", "search", "number"].includes(event.target.type);
    if (writing || this.state.note) return;
    const command = event.ctrlKey || event.metaKey;
    const key = event.key.toLowerCase();
    if (event.key === "Escape" && this.first) this.merge();
    else if (document.querySelector("dialog[open]")) return;
    else if (command && key === "z" && !event.shiftKey && this.state.done.length) void this.ask("undo");
    else if (command && ((key === "z" && event.shiftKey) || key === "y") && this.state.undone.length) void this.ask("redo");
    else if (event.key === "Delete" && !this.panel.hidden) this.ofSelected("delete");
    else return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  /** Ask for a change; the page is loaded again with it. Returns why nothing was changed. */
  private async ask(kind: CorrectionKind, change: Change = {}): Promise<string | null> {
    if (this.busy) return null;
    this.busy = true;
    const request: CorrectionRequest = { fruits: [], marks: [], size: [], tree: 0, ...change, kind, revision: this.state.revision };
    try {
      const answer = await fetch("corrections", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(request) });
      if (!answer.ok) throw await Refused.of(answer);
      const { changed, message, fruit } = (await answer.json()) as CorrectionAnswer;
      if (changed) {
        const selected = fruit || (kind === "delete" ? 0 : (this.page.selected()?.id ?? 0));
        // What was clicked in photos may lie anywhere in the view.
        remember(this.page.data, this.page.view, { message, fruit: selected, fly: kind === "add" });
        location.reload();
        return null;
      }
      return this.failed(message);
    } catch (error) {
      return this.failed(`Nothing was changed: ${whyOf(error)}`);
    }
  }

  private failed(message: string): string {
    this.busy = false;
    this.tell(message);
    return message;
  }

  private tell(message: string): void {
    this.text.textContent = message;
    say(message);
  }
}

/** Let the fruits be corrected, where a server can keep it. */
export function correcting(page: Correctable): Correcting | null {
  const { corrections, source } = page.data;
  return corrections && source === "server" ? new Correcting(page, corrections) : null;
}

