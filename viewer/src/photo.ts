/** The photo window: one whole photo with the outlines of all its detections; zoom, move, step to the next. */

import { find, pathOf, say, svg } from "./dom";
import { measured } from "./locale";
import type { Box, Detection, Fruit, Photo, Sighting } from "./payload";
import type { PhotoSource } from "./source";

const MOST_ZOOM = 40;

export class PhotoWindow {
  onFruit: (id: number) => void = () => {};
  onLookThrough: (photo: number) => void = () => {};
  onShow: (photo: number) => void = () => {};
  onClose: () => void = () => {};
  /** Hears clicks, in pixels of the photo; null: a click on an outline goes to its fruit. */
  onMark: ((x: number, y: number) => void) | null = null;
  /** The photos to step through; null: those of the fruit, or all. */
  order: number[] | null = null;

  private readonly dialog = find<HTMLDialogElement>("#photo");
  private readonly stage = find("#photo .stage");
  private readonly sheet = find("#photo .photo-sheet");
  private readonly image = find<HTMLImageElement>("#photo img");
  private readonly drawing = find<SVGSVGElement>("#photo svg.outlines");
  private readonly onlyMine = find<HTMLInputElement>("#photo-only");
  private at = 0;
  private fruit: Fruit | null = null;
  private seen: Sighting[] = [];
  /** Photo pixels to screen, and the place of the photo's corner. */
  private zoom = 1;
  private corner: [number, number] = [0, 0];
  /** How large the stage was, and how to fill it anew where it is of another size; null: a person has zoomed or moved. */
  private room: [number, number] = [0, 0];
  private frame: (() => void) | null = null;

  constructor(private readonly photos: Photo[], private readonly source: PhotoSource, private readonly byId: Map<number, Fruit>) {
    const buttons: [string, () => void][] = [
      ["#photo-previous", () => this.step(-1)], ["#photo-next", () => this.step(1)], ["#photo-in", () => this.zoomBy(1.5)],
      ["#photo-out", () => this.zoomBy(1 / 1.5)], ["#photo-whole", () => this.whole()], ["#photo-close", () => this.dialog.close()],
      ["#photo-through", () => { this.dialog.close(); this.onLookThrough(this.at); }],
    ];
    for (const [selector, act] of buttons) find(selector).addEventListener("click", act);
    this.dialog.addEventListener("keydown", (event) => this.key(event));
    this.dialog.addEventListener("close", () => {
      if (this.dialog.open) return; // opened again before this was told
      this.image.removeAttribute("src");
      this.onClose();
    });
    this.stage.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY / 400), this.onStage(event));
    }, { passive: false });
    this.source.watch(this.image, (why) => this.missing(why));
    this.image.addEventListener("load", () => this.missing(null));
    this.drag();
    new ResizeObserver(() => this.resized()).observe(this.stage);
  }

  /** Show a photo; where a fruit is selected, at its place there. */
  open(photo: number, fruit: Fruit | null, seen: Sighting[]): void {
    this.fruit = fruit;
    this.seen = seen;
    this.onlyMine.checked = fruit !== null && seen.length > 1;
    find("#photo-only-label").hidden = fruit === null;
    find("#photo-only-text").textContent = fruit ? `only photos of fruit ${fruit.id}` : "";
    if (!this.dialog.open) this.dialog.showModal();
    this.show(photo);
  }

  /** The photo that is shown. */
  get photo(): number {
    return this.at;
  }

  /** Show a photo, or a part of it, without a fruit that it is about. */
  openAt(photo: number, box?: Box): void {
    if (!this.dialog.open) this.open(photo, null, []);
    else this.show(photo);
    if (box) this.frameIt(() => { this.lookAt(box); this.keepInside(); });
  }

  /** Mark what is in the middle of the stage, for those who use no mouse. */
  markMiddle(): void {
    this.onMark?.(...this.pixelAt(this.stage.clientWidth / 2, this.stage.clientHeight / 2));
  }

  /** Where a pointer is on the stage, whatever lies there below it. */
  private onStage({ clientX, clientY }: MouseEvent): [number, number] {
    const { left, top } = this.stage.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  private frameIt(frame: () => void): void {
    this.frame = frame;
    this.room = [this.stage.clientWidth, this.stage.clientHeight];
    frame();
  }

  /** A window of another size, a turned phone: what is framed is framed again, else the middle stays in the middle. */
  private resized(): void {
    const { clientWidth, clientHeight } = this.stage;
    const [width, height] = this.room;
    if (!clientWidth || (clientWidth === width && clientHeight === height)) return;
    if (this.frame) this.frameIt(this.frame);
    else this.pan([(clientWidth - width) / 2, (clientHeight - height) / 2]);
    this.room = [clientWidth, clientHeight];
  }

  private pixelAt(x: number, y: number): [number, number] {
    return [(x - this.corner[0]) / this.zoom, (y - this.corner[1]) / this.zoom];
  }

  private show(index: number): void {
    const photo = this.photos[index]!;
    this.at = index;
    find("#photo-name").textContent = photo.name;
    this.missing(this.source.hasPhoto(photo) ? null : this.source.note);
    this.image.width = photo.width;
    this.image.height = photo.height;
    this.image.alt = `Photo ${photo.name}`;
    this.image.removeAttribute("src");
    this.sheet.style.width = `${photo.width}px`;
    this.sheet.style.height = `${photo.height}px`;
    this.drawing.setAttribute("viewBox", `0 0 ${photo.width} ${photo.height}`);
    this.drawing.replaceChildren();
    find("#photo-summary").textContent = "";
    const mine = this.seen.find((sighting) => sighting.photo === index);
    this.frameIt(() => {
      this.lookAt(mine ? around(mine.box, 6) : [0, 0, photo.width, photo.height]);
      if (mine) this.keepInside();
    });
    this.onShow(index);
    void this.source.ofPhoto(index).then((detections) => this.at === index && this.draw(detections), () => undefined);
  }

  /** Show why there is no photo; null where there is one. */
  private missing(why: string | null): void {
    find("#photo-missing").textContent = why;
    find("#photo-missing").hidden = why === null;
    this.image.hidden = why !== null;
  }

  private draw(detections: Detection[]): void {
    const shapes = detections.map((detection) => {
      const fruit = this.byId.get(detection.fruit);
      const kind = !fruit ? "loose" : fruit === this.fruit ? "mine" : "other";
      const shape = svg("path", { d: pathOf(detection.outline), class: `outline ${kind}` });
      const title = svg("title", {});
      const score = measured(detection.score, 2);
      title.textContent = fruit ? `Fruit ${fruit.id}, detected with score ${score}` : `Detected with score ${score}, became no fruit`;
      shape.append(title);
      shape.dataset.fruit = String(detection.fruit);
      return shape;
    });
    this.drawing.replaceChildren(...shapes);
    const fruits = detections.filter(({ fruit }) => this.byId.has(fruit)).length;
    const text = this.source.hasAllDetections ? detectedText(detections.length, fruits) : keptText(detections.length);
    find("#photo-summary").textContent = text;
    say(`Photo ${this.photos[this.at]!.name}. ${text}`);
  }

  private step(by: number): void {
    const mine = this.onlyMine.checked ? [...new Set(this.seen.map(({ photo }) => photo))].sort((a, b) => a - b) : [];
    const order = this.order ?? (mine.length ? mine : this.photos.map((_, i) => i));
    const at = order.indexOf(this.at);
    this.show(order[(at + by + order.length) % order.length]!);
  }

  /** Make a part of the photo fill the stage. */
  private lookAt(box: Box): void {
    const { clientWidth, clientHeight } = this.stage;
    this.zoom = Math.min(clientWidth / box[2], clientHeight / box[3]);
    this.corner = [clientWidth / 2 - (box[0] + box[2] / 2) * this.zoom, clientHeight / 2 - (box[1] + box[3] / 2) * this.zoom];
    this.place();
  }

  /** Where the photo is larger than the stage, it fills it. */
  private keepInside(): void {
    const photo = this.photos[this.at]!;
    const { clientWidth, clientHeight } = this.stage;
    const kept = (corner: number, size: number, room: number): number => (size > room ? Math.min(0, Math.max(room - size, corner)) : (room - size) / 2);
    this.corner = [kept(this.corner[0], photo.width * this.zoom, clientWidth), kept(this.corner[1], photo.height * this.zoom, clientHeight)];
    this.place();
  }

  private whole(): void {
    const photo = this.photos[this.at]!;
    this.frameIt(() => this.lookAt([0, 0, photo.width, photo.height]));
  }

  private zoomBy(factor: number, at: [number, number] = [this.stage.clientWidth / 2, this.stage.clientHeight / 2]): void {
    this.frame = null;
    const zoom = Math.min(Math.max(this.zoom * factor, 0.02), MOST_ZOOM);
    const by = zoom / this.zoom;
    this.corner = [at[0] - (at[0] - this.corner[0]) * by, at[1] - (at[1] - this.corner[1]) * by];
    this.zoom = zoom;
    this.place();
  }

  private place(): void {
    const photo = this.photos[this.at]!;
    this.sheet.style.transform = `translate(${this.corner[0]}px, ${this.corner[1]}px) scale(${this.zoom})`;
    if (!this.source.hasPhoto(photo)) return;
    const url = this.source.photo(photo, Math.max(photo.width, photo.height) * this.zoom * window.devicePixelRatio);
    if (this.image.getAttribute("src") === url) return;
    // The copy that is shown stays until the sharper one is there.
    if (!this.image.getAttribute("src")) this.image.src = url;
    else {
      const sharper = new Image();
      const index = this.at;
      sharper.onload = () => this.at === index && (this.image.src = url);
      sharper.src = url;
    }
  }

  private key(event: KeyboardEvent): void {
    const act: Record<string, () => void> = {
      ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1), "+": () => this.zoomBy(1.5), "-": () => this.zoomBy(1 / 1.5), "0": () => this.whole(),
    };
    const room = Math.min(this.stage.clientWidth, this.stage.clientHeight) / 6;
    const pan: Record<string, [number, number]> = { ArrowLeft: [room, 0], ArrowRight: [-room, 0], ArrowUp: [0, room], ArrowDown: [0, -room] };
    const by = event.shiftKey ? pan[event.key] : undefined;
    const does = by ? () => this.pan(by) : act[event.key];
    if (!does) return;
    event.preventDefault();
    does();
  }

  private pan([x, y]: [number, number]): void {
    this.frame = null;
    this.corner = [this.corner[0] + x, this.corner[1] + y];
    this.place();
  }

  private drag(): void {
    let from: { x: number; y: number; corner: [number, number] } | null = null;
    let moved = false;
    this.stage.addEventListener("pointerdown", (event) => {
      from = { x: event.clientX, y: event.clientY, corner: this.corner };
      moved = false;
    });
    this.stage.addEventListener("pointermove", (event) => {
      if (!from || !event.buttons) return;
      moved ||= Math.hypot(event.clientX - from.x, event.clientY - from.y) > 4;
      this.frame = null;
      this.corner = [from.corner[0] + event.clientX - from.x, from.corner[1] + event.clientY - from.y];
      this.place();
    });
    this.stage.addEventListener("click", (event) => {
      const id = Number((event.target as SVGElement).dataset.fruit ?? 0);
      if (moved) return;
      if (this.onMark) {
        this.onMark(...this.pixelAt(...this.onStage(event)));
        return;
      }
      if (!this.byId.has(id)) return;
      this.dialog.close();
      this.onFruit(id);
    });
  }
}

/** What was detected in a photo, in words; nothing where nothing was. */
export function detectedText(detections: number, fruits: number): string {
  if (!detections) return "";
  if (detections === 1) return fruits ? "1 detection, which became a fruit" : "1 detection, which became no fruit";
  return `${detections} detections, ${fruits} of them became ${fruits === 1 ? "a fruit" : "fruits"}`;
}

/** How many outlines of a photo a file has that was kept small, in words. */
export function keptText(outlines: number): string {
  return outlines ? `${outlines} ${outlines === 1 ? "outline" : "outlines"} of this photo in this file` : "";
}

function around(box: Box, times: number): Box {
  const [x, y, width, height] = box;
  return [x - ((times - 1) / 2) * width, y - ((times - 1) / 2) * height, times * width, times * height];
}
