/** Joins the 3D view, the table, the photos and the tools: what is selected in one is shown in the others. */

import "./style.css";
import type { SurveyData } from "./contract";
import { addCrops, fillCard, type CardWants } from "./card";
import { whyOf } from "./columns";
import { correcting, type Correcting } from "./correct";
import { element, find, say } from "./dom";
import { localisePage } from "./locale";
import { showPacking } from "./packing";
import { fruitsOf, photosOf, type Fruit, type Photo, type Sighting } from "./payload";
import { PhotoWindow } from "./photo";
import { loadSurvey, PhotoSource } from "./source";
import { FruitTable } from "./table";
import { Through } from "./through";
import { Tools } from "./tools";
import { View } from "./view";
import { following } from "./watch";

class Page {
  private readonly fruits: Fruit[];
  private readonly photos: Photo[];
  private readonly byId: Map<number, Fruit>;
  private readonly source: PhotoSource;
  private readonly table: FruitTable;
  private readonly photoWindow: PhotoWindow;
  private readonly box = find("#view");
  private readonly card = find("#card");
  private view: View | null = null;
  private through: Through | null = null;
  private correcting: Correcting | null = null;
  private selected: Fruit | null = null;
  /** Of the selected fruit, once they are known. */
  private sightings: Sighting[] = [];

  constructor(private readonly data: SurveyData) {
    this.fruits = fruitsOf(data);
    this.photos = photosOf(data);
    this.byId = new Map(this.fruits.map((fruit) => [fruit.id, fruit]));
    this.source = new PhotoSource(data);
    this.table = new FruitTable(find("#fruits"), data, this.fruits, (id) => this.select(id, "table"));
    showPacking(this.fruits);
    find("#no-fruits").hidden = this.fruits.length > 0;
    if (data.provisional) find("#no-fruits").textContent = "No fruit so far.";
    this.photoWindow = new PhotoWindow(this.photos, this.source, this.byId);
    this.photoWindow.onFruit = (id) => this.select(id, "photo");
    this.photoWindow.onLookThrough = (photo) => this.lookThrough(photo);
  }

  /** Without WebGL the table, the panel and the photos still work. */
  start(): void {
    try {
      this.view = new View(this.box, this.data, this.fruits, this.photos, this.source);
    } catch {
      document.documentElement.classList.add("no-webgl");
      find("#no-webgl").hidden = false;
      return;
    }
    const { view } = this;
    this.through = new Through(view, this.box, this.photos, this.source);
    this.through.onPhoto = (photo) => this.photoWindow.open(photo, this.selected, this.sightings);
    const tools = new Tools(view, this.data, this.fruits, this.box);
    tools.onFind = (id) => this.select(id, "table");
    tools.onShown = (shown) => this.table.filter(({ index }) => shown[index]!);
    tools.start();
    view.onPick = (picked, at) => {
      if (tools.measure.on) tools.measure.click(at);
      else if (picked && "camera" in picked) this.lookThrough(picked.camera);
      else this.select(picked ? this.fruits[picked.fruit]!.id : null, "view");
    };
    const tip = find("#tip");
    view.onHover = (text, x, y) => {
      tip.hidden = text === null;
      tip.textContent = text;
      tip.style.transform = `translate(${x + 14}px, ${y + 14}px)`;
    };
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || document.querySelector("dialog[open]")) return;
      if (view.navigation.through) view.navigation.leave();
      else this.select(null, "view");
    });
    document.documentElement.classList.add("has-webgl");
  }

  /** Let the fruits be corrected, where that can be kept. */
  correct(): void {
    const { data, photos, photoWindow, view } = this;
    this.correcting = correcting({
      data, photos, photoWindow, view, selected: () => this.selected, sightings: () => this.sightings, select: (id, fly) => this.select(id, fly ? "photo" : "view"),
      focusRow: (at) => this.table.focus(at),
    });
    this.correcting?.restore();
  }

  /** Follow photos that still arrive. */
  follow(): void {
    const { data, photos, source, view } = this;
    following({ data, photos, source, view, sightings: () => this.sightings, select: (id) => this.select(id, "view") });
  }

  private lookThrough(photo: number): void {
    this.box.scrollIntoView({ block: "nearest" });
    this.through?.open(photo);
  }

  private select(id: number | null, from: "view" | "table" | "photo"): void {
    const fruit = id === null ? undefined : this.byId.get(id);
    if (id !== null && !fruit) {
      say(`There is no fruit ${id}`);
      return;
    }
    this.selected = fruit ?? null;
    this.sightings = [];
    this.table.show(this.selected);
    this.view?.select(fruit ? fruit.index : null, from !== "view");
    this.correcting?.selected(this.selected);
    if (!fruit) {
      this.card.hidden = true;
      return;
    }
    const wants: CardWants = {
      metric: this.data.metric,
      unit: this.data.unit,
      origin: this.data.origin,
      onClose: () => this.select(null, "view"),
      onOpen: (sighting) => this.photoWindow.open(sighting.photo, fruit, this.sightings),
    };
    fillCard(this.card, fruit, wants);
    void this.look(fruit, wants);
    say(`Fruit ${fruit.id} selected, seen in ${fruit.views === 1 ? "1 photo" : `${fruit.views} photos`}`);
    if (from === "table") this.box.scrollIntoView({ block: "nearest", behavior: "smooth" });
  }

  /** Show what photos saw of the selected fruit. */
  private async look(fruit: Fruit, wants: CardWants): Promise<void> {
    try {
      const seen = await this.source.ofFruit(fruit);
      if (this.selected !== fruit) return;
      this.sightings = seen.sightings;
      this.view?.connect(fruit, seen.sightings.map(({ photo }) => photo));
      addCrops(this.card, fruit, seen, this.photos, this.source, wants);
    } catch (error) {
      if (this.selected === fruit) this.card.append(element("p", `What photos saw of it could not be loaded: ${whyOf(error)}`, "note"));
    }
  }
}

async function start(): Promise<void> {
  localisePage();
  try {
    const page = new Page(await loadSurvey(find("#survey-data")));
    page.start();
    page.correct();
    page.follow();
  } catch (error) {
    const note = find("#no-data");
    note.hidden = false;
    find("#no-data-reason").textContent = String(error);
    document.documentElement.classList.add("no-data");
  }
}

void start();
