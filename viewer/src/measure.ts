/** A distance between two clicked places. */

import * as three from "three";
import { find, say } from "./dom";
import { measured } from "./locale";
import type { View } from "./view";

const COLOUR = 0xd1006c;

export class Measure {
  private places: three.Vector3[] = [];
  private line: three.Object3D | null = null;
  private readonly label = find("#measured");

  constructor(private readonly view: View, box: HTMLElement, private readonly unit: string) {
    box.addEventListener("drawn", () => this.place());
  }

  get on(): boolean {
    return this.view.picksPoints;
  }

  toggle(): void {
    this.view.picksPoints = !this.view.picksPoints;
    this.clear();
    if (this.on) this.tell("Click two places: fruits or points");
  }

  click(at: three.Vector3 | null): void {
    if (!at) {
      this.tell("No point there: click a fruit or a point");
      return;
    }
    if (this.places.length === 2) this.clear();
    this.places.push(at);
    if (this.places.length === 2) this.tell(`${measured(this.places[0]!.distanceTo(at), 3)} ${this.unit}`);
    else this.tell("Now the second place");
    this.show();
  }

  private clear(): void {
    this.places = [];
    if (this.line) this.view.remove(this.line);
    this.line = null;
    this.label.hidden = true;
  }

  private tell(text: string): void {
    this.label.textContent = text;
    this.label.hidden = false;
    say(text);
    this.place();
  }

  private show(): void {
    if (this.line) this.view.remove(this.line);
    const geometry = new three.BufferGeometry().setFromPoints(this.places);
    this.line = new three.Group();
    const line = new three.Line(geometry, new three.LineBasicMaterial({ color: COLOUR, depthTest: false }));
    const ends = new three.Points(geometry, new three.PointsMaterial({ color: COLOUR, size: 9, sizeAttenuation: false, depthTest: false }));
    line.renderOrder = ends.renderOrder = 11;
    this.line.add(line, ends);
    this.view.add(this.line);
  }

  /** The label stands at the middle of the line, or at the top while there is none. */
  private place(): void {
    if (this.label.hidden) return;
    const middle = this.places.length === 2 ? this.view.onScreen(this.places[0]!.clone().lerp(this.places[1]!, 0.5)) : null;
    this.label.style.transform = middle ? `translate(${middle.x}px, ${middle.y}px) translate(-50%, -140%)` : "";
    this.label.classList.toggle("at-top", !middle);
  }
}
