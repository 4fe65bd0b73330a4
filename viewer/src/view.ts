/** The 3D view: layers, light, picking. Draws only when something changed, so that an open page costs nothing. */

import * as three from "three";
import type { SurveyData } from "./contract";
import { colouring, type ColourBy, type Colouring } from "./colours";
import { Frusta, FruitBalls, ground, halo, points, sightLines } from "./layers";
import { Navigation } from "./navigation";
import type { Fruit, Photo } from "./payload";
import { row } from "./row";

export type Layer = "scene" | "fruitPoints" | "fruits" | "cameras" | "row" | "ground";
export type Picked = { fruit: number } | { camera: number } | null;

const CLICK_PX = 5;
const FINGER_PX = 7;
const CAMERA_PX = 12;
/** How long the picture has to stand still until all points are drawn; and how many are while it moves, of each kind. */
const STANDS_MS = 250;
const MOVING_POINTS = 100_000;

export class View {
  onPick: (picked: Picked, at: three.Vector3 | null) => void = () => {};
  onHover: (text: string | null, x: number, y: number) => void = () => {};
  /** Points are picked for measuring, and not only fruits and cameras. */
  picksPoints = false;

  readonly navigation: Navigation;
  private readonly renderer: three.WebGLRenderer;
  private readonly world = new three.Scene();
  private readonly layers: Record<Layer, three.Object3D>;
  private readonly balls: FruitBalls;
  private readonly frusta: Frusta;
  private readonly halo = halo();
  private readonly extra = new three.Group();
  private readonly shows = { cameras: true };
  private sight: three.LineSegments | null = null;
  private readonly lamp = new three.DirectionalLight(0xffffff, 2.0);
  private pending = false;
  private lastPlace = "";
  private movedAt = -Infinity;
  private later = 0;

  /** Throws where the browser gives no WebGL. */
  constructor(private readonly box: HTMLElement, private readonly data: SurveyData, private readonly fruits: Fruit[], private readonly photos: Photo[]) {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2", { antialias: true, powerPreference: "high-performance" });
    if (!context) throw new Error("This browser gives no WebGL 2");
    this.renderer = new three.WebGLRenderer({ canvas, context });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.localClippingEnabled = true;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "3D view of points, fruits and cameras. Arrow keys turn it, plus and minus zoom. The table of fruits says the same in words.");
    box.prepend(canvas);

    this.balls = new FruitBalls(fruits);
    this.frusta = new Frusta(data);
    const { radius } = data.view;
    this.layers = {
      scene: points(data.scene, radius),
      fruitPoints: points(data.fruitPoints, radius),
      fruits: this.balls.object,
      cameras: this.frusta.object,
      row: row(data),
      ground: ground(data),
    };
    this.world.add(...Object.values(this.layers), this.extra, this.halo, this.lamp, new three.HemisphereLight(0xffffff, 0x8c8a80, 2.2));
    this.navigation = new Navigation(canvas, box, data, fruits, () => this.draw());
    this.paper();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paper());
    this.listen(canvas);
    this.resize();
    this.navigation.look("photos", false);
  }

  show(layer: Layer, visible: boolean): void {
    this.layers[layer].visible = visible;
    if (layer === "cameras") this.shows.cameras = visible;
    if (layer === "fruitPoints") this.balls.seeThrough(visible);
    this.draw();
  }

  showFruits(shown: boolean[]): void {
    this.balls.show(shown);
    this.draw();
  }

  colourBy(by: ColourBy): Colouring {
    return this.colour(colouring(by, this.fruits));
  }

  colour(colours: Colouring): Colouring {
    this.balls.colour(colours);
    this.draw();
    return colours;
  }

  /** Show only what is on the positive side of all planes: points, not the fruits, which are shown whole or not at all. */
  clip(planes: three.Plane[]): void {
    for (const layer of ["scene", "fruitPoints"] as const) {
      ((this.layers[layer] as three.Points).material as three.Material).clippingPlanes = planes;
    }
    this.draw();
  }

  /** Objects of others, such as a measured line. */
  add(object: three.Object3D): void {
    this.extra.add(object);
    this.draw();
  }

  remove(object: three.Object3D): void {
    this.extra.remove(object);
    this.draw();
  }

  /** Mark a fruit, draw its sight lines and, where `fly`, go near it. */
  select(index: number | null, cameras: number[], fly: boolean): void {
    if (this.sight) {
      this.world.remove(this.sight);
      this.sight.geometry.dispose();
      this.sight = null;
    }
    this.halo.visible = index !== null;
    const fruit = index === null ? undefined : this.fruits[index];
    if (fruit) {
      const radius = this.balls.radii[fruit.index]!;
      this.halo.position.set(fruit.x, fruit.y, fruit.z);
      this.halo.scale.setScalar(radius);
      this.sight = sightLines(fruit, cameras, this.frusta);
      this.world.add(this.sight);
      if (fly) this.navigation.flyTo(new three.Vector3(fruit.x, fruit.y, fruit.z), radius);
    }
    this.draw();
  }

  /** Where a place in the world is on the page's view, in pixels; null behind the viewer. */
  onScreen(place: three.Vector3): { x: number; y: number } | null {
    const at = place.clone().project(this.navigation.camera);
    if (at.z > 1) return null;
    return { x: ((at.x + 1) / 2) * this.box.clientWidth, y: ((1 - at.y) / 2) * this.box.clientHeight };
  }

  /** Take the paper's colour from the style. */
  paper(): void {
    this.world.background = new three.Color(getComputedStyle(this.box).backgroundColor);
    this.draw();
  }

  /** Fewer points while the picture moves, all of them once it stands. */
  private thin(): void {
    const now = performance.now();
    const place = [...this.navigation.camera.position.toArray(), ...this.navigation.controls.target.toArray()].join();
    if (place !== this.lastPlace) this.movedAt = now;
    this.lastPlace = place;
    const moves = now - this.movedAt < STANDS_MS;
    for (const layer of ["scene", "fruitPoints"] as const) {
      const { geometry } = this.layers[layer] as three.Points;
      geometry.setDrawRange(0, moves ? MOVING_POINTS : Infinity);
    }
    window.clearTimeout(this.later);
    if (moves) this.later = window.setTimeout(() => this.draw(), STANDS_MS + 10);
  }

  draw(): void {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => {
      this.pending = false;
      this.navigation.step(now);
      const { camera, controls, through } = this.navigation;
      // In a camera's place, the lines to and of cameras would only be in the way.
      this.frusta.object.visible = this.shows.cameras && !through;
      if (this.sight) this.sight.visible = !through;
      this.lamp.position.copy(camera.position).add(new three.Vector3(0, 0, this.data.view.radius));
      this.lamp.target.position.copy(controls.target);
      this.lamp.target.updateMatrixWorld();
      this.halo.quaternion.copy(camera.quaternion);
      this.thin();
      this.renderer.render(this.world, camera);
      this.box.dispatchEvent(new Event("drawn"));
    });
  }

  private listen(canvas: HTMLCanvasElement): void {
    let down: { x: number; y: number } | null = null;
    canvas.addEventListener("pointerdown", (event) => (down = event.isPrimary ? { x: event.clientX, y: event.clientY } : null));
    canvas.addEventListener("pointerup", (event) => {
      if (down && Math.hypot(event.clientX - down.x, event.clientY - down.y) < CLICK_PX) {
        const { picked, at } = this.pick(event);
        this.onPick(picked, at);
      }
      down = null;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.pointerType === "mouse" && event.buttons === 0) this.hover(event);
    });
    canvas.addEventListener("pointerleave", () => this.onHover(null, 0, 0));
    new ResizeObserver(() => this.resize()).observe(this.box);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.box;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.navigation.resize(clientWidth / clientHeight);
    this.draw();
  }

  private ray(event: PointerEvent): three.Raycaster {
    const { offsetX, offsetY } = event;
    const pointer = new three.Vector2((2 * offsetX) / this.box.clientWidth - 1, 1 - (2 * offsetY) / this.box.clientHeight);
    const caster = new three.Raycaster();
    caster.setFromCamera(pointer, this.navigation.camera);
    return caster;
  }

  private pick(event: PointerEvent): { picked: Picked; at: three.Vector3 | null } {
    const caster = this.ray(event);
    const slack = event.pointerType === "touch" ? (FINGER_PX * three.MathUtils.degToRad(this.navigation.camera.fov)) / this.box.clientHeight : 0;
    const fruit = this.layers.fruits.visible ? this.balls.hit(caster.ray, slack) : null;
    if (fruit !== null) {
      const { x, y, z } = this.fruits[fruit]!;
      return { picked: { fruit }, at: new three.Vector3(x, y, z) };
    }
    if (this.picksPoints) return { picked: null, at: this.pointNear(caster) };
    const camera = this.cameraNear(event.offsetX, event.offsetY);
    return { picked: camera === null ? null : { camera }, at: null };
  }

  private pointNear(caster: three.Raycaster): three.Vector3 | null {
    caster.params.Points.threshold = this.data.view.radius / 100;
    const clouds = [this.layers.scene, this.layers.fruitPoints].filter((cloud) => cloud.visible);
    return caster.intersectObjects(clouds, false)[0]?.point ?? null;
  }

  private hover(event: PointerEvent): void {
    const { picked } = this.picksPoints ? { picked: null } : this.pick(event);
    const name = !picked ? null : "fruit" in picked ? `Fruit ${this.fruits[picked.fruit]!.id}` : `${this.photos[picked.camera]!.name}: click to look through`;
    this.renderer.domElement.style.cursor = this.picksPoints ? "crosshair" : picked ? "pointer" : "grab";
    this.onHover(name, event.offsetX, event.offsetY);
  }

  private cameraNear(x: number, y: number): number | null {
    if (!this.layers.cameras.visible || this.navigation.through !== null) return null;
    let nearest = CAMERA_PX;
    let found: number | null = null;
    for (let i = 0; i < this.frusta.count; i++) {
      const at = this.onScreen(this.frusta.center(i));
      const away = at ? Math.hypot(at.x - x, at.y - y) : Infinity;
      if (away < nearest) [nearest, found] = [away, i];
    }
    return found;
  }
}
