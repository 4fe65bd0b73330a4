/** The 3D view: layers, light, picking. Draws only when something changed, so that an open page costs nothing. */

import * as three from "three";
import type { SurveyData } from "./contract";
import type { Colouring } from "./colours";
import { earlierFruits } from "./earlier";
import { FramedPhotos, wanted } from "./framed";
import { Frusta, FruitBalls, ground, halo, sightLines } from "./layers";
import { Navigation } from "./navigation";
import type { Fruit, Photo } from "./payload";
import { LATER, PointCloud } from "./points";
import { row, thinLabels } from "./row";
import type { PhotoSource } from "./source";

export type Layer = "scene" | "fruitPoints" | "fruits" | "cameras" | "row" | "ground" | "earlier";
export type Picked = { fruit: number } | { camera: number } | null;

const CLICK_PX = 5;
const FINGER_PX = 7;
const CAMERA_PX = 12;
const POINT_PX = 8;
/** How long the picture has to stand still until all points are drawn, as sharp as the screen is. */
const STANDS_MS = 250;
/** Motion that cannot be seen, in radii of the scene. */
const STEP = 1e-5;
/** Points of each cloud while it moves, and pixels to each of the screen's along a side: with a graphics card, and without. */
const MOVING = { hardware: { points: 250_000, sharpness: 1 }, software: { points: 60_000, sharpness: 0.5 } };

export class View {
  onPick: (picked: Picked, at: three.Vector3 | null) => void = () => {};
  onHover: (text: string | null, x: number, y: number) => void = () => {};
  /** Points are picked for measuring, and not only fruits and cameras. */
  picksPoints = false;

  readonly navigation: Navigation;
  private readonly renderer: three.WebGLRenderer;
  private readonly world = new three.Scene();
  private readonly layers: Record<Layer, three.Object3D>;
  private readonly clouds: { scene: PointCloud; fruitPoints: PointCloud };
  private readonly balls: FruitBalls;
  private readonly frusta: Frusta;
  private readonly framed: FramedPhotos;
  private readonly halo = halo();
  private readonly extra = new three.Group();
  private readonly shows = { cameras: true };
  private sight: three.LineSegments | null = null;
  private pending = false;
  private readonly moving: (typeof MOVING)["hardware"];
  private readonly sharpness = Math.min(window.devicePixelRatio, 2);
  /** Pieces of clouds that are not in the picture yet; null while it has to be drawn afresh. */
  private rest: three.Points[] | null = null;
  private readonly step: number;
  private stands = false;
  private lastPlace = "";
  private movedAt = -Infinity;
  private later = 0;

  /** Throws where the browser gives no WebGL. */
  constructor(private readonly box: HTMLElement, data: SurveyData, private readonly fruits: Fruit[], private readonly photos: Photo[], source: PhotoSource) {
    const canvas = document.createElement("canvas");
    const software = drawsInSoftware();
    // What was drawn is kept, as more points are drawn over it. Smooth edges take a processor twice as long.
    const context = canvas.getContext("webgl2", { antialias: !software, preserveDrawingBuffer: true, powerPreference: "high-performance" });
    if (!context) throw new Error("This browser gives no WebGL 2");
    this.step = data.view.radius * STEP;
    this.moving = MOVING[software ? "software" : "hardware"];
    this.renderer = new three.WebGLRenderer({ canvas, context });
    this.renderer.setPixelRatio(this.sharpness);
    this.renderer.localClippingEnabled = true;
    this.renderer.autoClear = false;
    canvas.id = "picture";
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", "3D view of points, fruits and cameras. Arrow keys turn it, plus and minus zoom. The table of fruits says the same in words.");
    box.prepend(canvas);

    this.balls = new FruitBalls(fruits, data.fruits.centers);
    this.frusta = new Frusta(data);
    this.framed = new FramedPhotos(this.frusta, (i) => source.small(photos[i]!), () => this.draw());
    this.clouds = {
      scene: new PointCloud(data.scene, data.view, (piece) => source.points("scene", piece), (came) => this.came(came)),
      fruitPoints: new PointCloud(data.fruitPoints, data.view, (piece) => source.points("fruit", piece), (came) => this.came(came)),
    };
    this.layers = {
      scene: this.clouds.scene.object,
      fruitPoints: this.clouds.fruitPoints.object,
      fruits: this.balls.object,
      cameras: this.frusta.object,
      row: row(data),
      ground: ground(data),
      earlier: data.earlier ? earlierFruits(data.earlier, data.fruits.centers) : new three.Group(),
    };
    this.world.add(...Object.values(this.layers), this.extra, this.halo, this.framed.object);
    this.world.traverse(staysOnTop);
    this.navigation = new Navigation(canvas, box, data, fruits, !software, () => this.draw());
    this.paper();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paper());
    this.listen(canvas);
    this.printStill();
    this.resize();
    this.navigation.look("photos", false);
  }

  show(layer: Layer, visible: boolean): void {
    this.layers[layer].visible = visible;
    if (layer === "cameras") this.shows.cameras = visible;
    if (layer === "fruitPoints") this.balls.seeThrough(visible);
    this.getPoints();
    this.draw();
  }

  showFruits(shown: boolean[]): void {
    this.balls.show(shown);
    this.draw();
  }

  colour(colours: Colouring): Colouring {
    this.balls.colour(colours);
    this.draw();
    return colours;
  }

  /** Show only what is on the positive side of all planes: points, not the fruits, which are shown whole or not at all. */
  clip(planes: three.Plane[]): void {
    for (const cloud of Object.values(this.clouds)) cloud.clip(planes);
    this.draw();
  }

  /** Objects of others, such as a measured line. */
  add(object: three.Object3D): void {
    object.traverse(staysOnTop);
    this.extra.add(object);
    this.draw();
  }

  remove(object: three.Object3D): void {
    this.extra.remove(object);
    this.draw();
  }

  /** Mark a fruit and, where `fly`, go near it. */
  select(index: number | null, fly: boolean): void {
    this.connect(null, []);
    this.halo.visible = index !== null;
    const fruit = index === null ? undefined : this.fruits[index];
    if (!fruit) return;
    const radius = this.balls.radii[fruit.index]!;
    this.halo.position.set(fruit.x, fruit.y, fruit.z);
    this.halo.scale.setScalar(radius);
    if (fly) this.navigation.flyTo(new three.Vector3(fruit.x, fruit.y, fruit.z), radius);
  }

  /** Draw lines from a fruit to cameras that saw it, and none from others. */
  connect(fruit: Fruit | null, cameras: number[]): void {
    if (this.sight) {
      this.world.remove(this.sight);
      this.sight.geometry.dispose();
    }
    this.sight = fruit && sightLines(fruit, cameras, this.frusta);
    if (this.sight) this.world.add(this.sight);
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
    this.renderer.setClearColor(new three.Color(getComputedStyle(this.box).backgroundColor));
    this.draw();
  }

  /** Draw afresh before long. */
  draw(): void {
    this.rest = null;
    this.schedule();
  }

  /** Whether the picture stands still and lacks nothing that is here. */
  private get whole(): boolean {
    return this.stands && this.rest?.length === 0 && !(this.framed.object.visible && this.framed.comes);
  }

  private schedule(): void {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => {
      this.pending = false;
      if (this.rest) this.drawRest();
      else this.drawFirst(now);
      if (this.rest?.length) this.schedule();
      this.box.dataset.picture = this.whole ? "whole" : "coming";
    });
  }

  /** A picture with few points while it moves; once it stands, with the others to come. */
  private drawFirst(now: number): void {
    this.rest = [];
    this.navigation.step(now);
    const { camera, controls, through } = this.navigation;
    // In a camera's place, the lines to and of cameras would only be in the way.
    this.frusta.object.visible = this.framed.object.visible = this.shows.cameras && !through;
    if (this.sight) this.sight.visible = !through;
    this.halo.quaternion.copy(camera.quaternion);
    // Less than one sees is no motion: damping goes on for ever.
    const moves = this.moves([...camera.position.toArray(), ...controls.target.toArray()].map((part) => Math.round(part / this.step)).join());
    for (const cloud of Object.values(this.clouds)) cloud.limit(moves ? this.moving.points : Infinity);
    const sharpness = this.sharpness * (moves ? this.moving.sharpness : 1);
    if (sharpness !== this.renderer.getPixelRatio()) this.renderer.setPixelRatio(sharpness);
    thinLabels(this.layers.row, camera);
    camera.layers.set(0);
    this.renderer.clear();
    this.renderer.render(this.world, camera);
    this.stands = !moves;
    if (this.stands && this.framed.object.visible) this.getPhotos();
    if (this.stands && this.rest) this.rest = Object.values(this.clouds).flatMap((cloud) => cloud.later);
    this.box.dispatchEvent(new Event("drawn"));
  }

  /** Draw the next piece of the points over what is there. */
  private drawRest(): void {
    const piece = this.rest!.shift();
    if (!piece) return;
    for (const cloud of Object.values(this.clouds)) for (const other of cloud.later) other.visible = other === piece;
    this.navigation.camera.layers.set(LATER);
    this.renderer.render(this.world, this.navigation.camera);
  }

  /** Whether the picture moves, by the place from which it is seen. */
  private moves(place: string): boolean {
    const now = performance.now();
    if (place !== this.lastPlace) this.movedAt = now;
    this.lastPlace = place;
    const moves = now - this.movedAt < STANDS_MS;
    window.clearTimeout(this.later);
    if (moves) this.later = window.setTimeout(() => this.draw(), STANDS_MS + 10);
    return moves;
  }

  /** Get more points of the clouds that are shown, once the first picture is there. */
  private getPoints(): void {
    const get = (): void => {
      for (const cloud of Object.values(this.clouds)) if (cloud.object.visible) void cloud.load().catch(() => undefined);
    };
    requestAnimationFrame(() => window.setTimeout(get));
  }

  /** Get the photos of cameras that can be made out, once the picture is there. */
  private getPhotos(): void {
    const { camera } = this.navigation;
    const pixels = this.box.clientHeight / (2 * Math.tan(three.MathUtils.degToRad(camera.fov) / 2));
    const sizes = Array.from({ length: this.frusta.count }, (_, i) => {
      const at = this.onScreen(this.frusta.center(i));
      const seen = at !== null && at.x > 0 && at.y > 0 && at.x < this.box.clientWidth && at.y < this.box.clientHeight;
      return seen ? (pixels * this.frusta.width(i)) / this.frusta.center(i).distanceTo(camera.position) : NaN;
    });
    this.framed.want(wanted(sizes));
  }

  /** A piece that comes late is drawn over the picture, unless that will be drawn afresh. */
  private came(piece: three.Points): void {
    if (!this.rest || !this.stands) return;
    this.rest.push(piece);
    this.schedule();
  }

  /** On paper, the view is the picture that it was. */
  private printStill(): void {
    const still = document.createElement("img");
    still.id = "still";
    still.alt = "The row in 3D, as it was seen";
    this.box.append(still);
    window.addEventListener("beforeprint", () => (still.src = this.renderer.domElement.toDataURL("image/jpeg", 0.9)));
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
    if (this.picksPoints) return { picked: null, at: this.pointNear(caster.ray) };
    const camera = this.cameraNear(event.offsetX, event.offsetY);
    return { picked: camera === null ? null : { camera }, at: null };
  }

  private pointNear(ray: three.Ray): three.Vector3 | null {
    const slack = (POINT_PX * three.MathUtils.degToRad(this.navigation.camera.fov)) / this.box.clientHeight;
    const found = Object.values(this.clouds).map((cloud) => cloud.hit(ray, slack)).filter((place) => place !== null);
    return found.sort((a, b) => a.distanceToSquared(ray.origin) - b.distanceToSquared(ray.origin))[0] ?? null;
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

/** Have what hides nothing behind it drawn again over points that come later. */
function staysOnTop(object: three.Object3D): void {
  const { material } = object as Partial<three.Mesh>;
  if (material instanceof three.Material && !(material.depthTest && material.depthWrite)) object.layers.enable(LATER);
}

/** Whether pictures are computed without a graphics card, as far as the browser says. */
function drawsInSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) return false;
  let name = String(context.getParameter(context.RENDERER));
  if (name === "WebKit WebGL") {
    // Browsers that hide the name there tell it here; others complain of the question.
    const told = context.getExtension("WEBGL_debug_renderer_info");
    if (told) name = String(context.getParameter(told.UNMASKED_RENDERER_WEBGL));
  }
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
