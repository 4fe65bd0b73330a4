/** Looking through a camera: its photo over the scene, more or less transparent. */

import { find, say } from "./dom";
import type { Photo } from "./payload";
import type { PhotoSource } from "./source";
import type { View } from "./view";

export class Through {
  onPhoto: (photo: number) => void = () => {};
  private readonly panel = find("#through");
  private readonly image = find<HTMLImageElement>("#through-photo");
  private readonly opacity = find<HTMLInputElement>("#through-opacity");

  constructor(private readonly view: View, box: HTMLElement, private readonly photos: Photo[], private readonly source: PhotoSource) {
    this.opacity.addEventListener("input", () => this.fade());
    this.source.watch(this.image, (why) => {
      // So that it is asked for again with the next look.
      this.image.removeAttribute("src");
      this.missing(why);
    });
    find("#through-previous").addEventListener("click", () => this.step(-1));
    find("#through-next").addEventListener("click", () => this.step(1));
    find("#through-close").addEventListener("click", () => view.navigation.leave());
    find("#through-open").addEventListener("click", () => view.navigation.through && this.onPhoto(view.navigation.through.index));
    view.navigation.onLeave = () => this.close();
    new ResizeObserver(() => view.navigation.through && this.open(view.navigation.through.index)).observe(box);
  }

  open(index: number): void {
    const photo = this.photos[index]!;
    const place = this.view.navigation.lookThrough(photo);
    Object.assign(this.image.style, { left: `${place.left}px`, top: `${place.top}px`, width: `${place.width}px`, height: `${place.height}px` });
    const there = this.source.hasPhoto(photo);
    const url = there ? this.source.straight(photo, Math.max(place.width, place.height) * window.devicePixelRatio) : "";
    if (there && this.image.getAttribute("src") !== url) this.image.src = url;
    this.image.alt = `Photo ${photo.name}`;
    find("#through-name").textContent = photo.name;
    this.missing(there ? null : this.source.note);
    if (this.panel.hidden) say(`Looking through the camera of ${photo.name}`);
    this.panel.hidden = false;
    this.fade();
  }

  /** Show why there is no photo; null where there is one. */
  private missing(why: string | null): void {
    find("#through-note").textContent = why;
    for (const part of [this.image, find("#through-opacity-label"), find("#through-open")]) part.hidden = why !== null;
  }

  private close(): void {
    this.panel.hidden = true;
    this.image.hidden = true;
  }

  private step(by: number): void {
    const at = this.view.navigation.through?.index ?? 0;
    this.open((at + by + this.photos.length) % this.photos.length);
  }

  private fade(): void {
    this.image.style.opacity = String(1 - Number(this.opacity.value) / 100);
  }
}
