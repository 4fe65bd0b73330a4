/** The 3D view: camera, light, picking. Draws only when something changed, so that an open report costs nothing. */

import * as three from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { colouring, type ColourBy, type Colouring } from "./colours";
import { Frusta, FruitBalls, ground, halo, points, sightLines } from "./layers";
import type { Fruit, Payload } from "./payload";

export type Layer = "scene" | "fruitPoints" | "fruits" | "cameras" | "ground";
export type Side = "front" | "back" | "top";

const FOV_DEG = 42;
const CLICK_PX = 5;
const FINGER_PX = 7;

export class View {
  onPick: (fruit: number | null) => void = () => {};
  onHover: (text: string | null, x: number, y: number) => void = () => {};

  private readonly renderer: three.WebGLRenderer;
  private readonly world = new three.Scene();
  private readonly camera: three.PerspectiveCamera;
  private readonly controls: OrbitControls;
  private readonly layers: Record<Layer, three.Object3D>;
  private readonly balls: FruitBalls;
  private readonly frusta: Frusta;
  private readonly halo = halo();
  private sight: three.LineSegments | null = null;
  private readonly lamp = new three.DirectionalLight(0xffffff, 2.0);
  private pending = false;
  private flight: { from: [three.Vector3, three.Vector3]; to: [three.Vector3, three.Vector3]; start: number } | null = null;

  /** Throws where the browser gives no WebGL. */
  constructor(private readonly box: HTMLElement, private readonly payload: Payload, private readonly fruits: Fruit[]) {
    const canvas = document.createElement("canvas");
    const context = canvas.getContext("webgl2", { antialias: true, powerPreference: "high-performance" });
    if (!context) throw new Error("This browser gives no WebGL 2");
    this.renderer = new three.WebGLRenderer({ canvas, context });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.domElement.setAttribute("aria-label", "3D view of points, fruits and cameras");
    box.prepend(this.renderer.domElement);

    const { radius } = payload.view;
    this.camera = new three.PerspectiveCamera(FOV_DEG, 1, radius / 500, radius * 60);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.12;
    this.controls.zoomToCursor = true;
    this.controls.minDistance = radius / 100;
    this.controls.maxDistance = radius * 20;
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.flight = null));

    this.balls = new FruitBalls(fruits);
    this.frusta = new Frusta(payload);
    this.layers = {
      scene: points(payload.scene, radius),
      fruitPoints: points(payload.fruitPoints, radius),
      fruits: this.balls.object,
      cameras: this.frusta.object,
      ground: ground(payload),
    };
    this.world.add(...Object.values(this.layers), this.halo, this.lamp, new three.HemisphereLight(0xffffff, 0x8c8a80, 2.2));
    const dark = matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.paper());
    this.paper();
    this.listen();
    this.resize();
    this.look("front", false);
  }

  show(layer: Layer, visible: boolean): void {
    this.layers[layer].visible = visible;
    if (layer === "fruitPoints") this.balls.seeThrough(visible);
    this.draw();
  }

  colourBy(by: ColourBy): Colouring {
    const colours = colouring(by, this.fruits);
    this.balls.colour(colours);
    this.draw();
    return colours;
  }

  /** Look at everything from one of the row's sides or from above. */
  look(side: Side, smooth = true): void {
    const { target, radius, toward, along } = this.payload.view;
    const aspect = Math.max(this.camera.aspect, 0.2);
    const half = three.MathUtils.degToRad(FOV_DEG / 2);
    const distance = (0.95 * radius) / Math.sin(Math.min(half, Math.atan(Math.tan(half) * aspect)));
    const outward = new three.Vector3().fromArray(toward).multiplyScalar(side === "back" ? -1 : 1);
    // Not quite straight down or straight ahead: a little of the other directions shows depth.
    const direction = side === "top" ? outward.multiplyScalar(0.02).add(new three.Vector3(0, 0, 1))
      : outward.add(new three.Vector3(0, 0, 0.22)).addScaledVector(new three.Vector3().fromArray(along), 0.3);
    const aim = new three.Vector3().fromArray(target);
    this.fly(aim.clone().addScaledVector(direction.normalize(), distance), aim, smooth);
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
      if (fly) this.flyTo(fruit, radius);
    }
    this.draw();
  }

  private paper(): void {
    this.world.background = new three.Color(getComputedStyle(this.box).backgroundColor);
    this.draw();
  }

  private flyTo(fruit: Fruit, radius: number): void {
    const aim = new three.Vector3(fruit.x, fruit.y, fruit.z);
    const outward = this.camera.position.clone().sub(this.controls.target).normalize();
    const distance = Math.min(this.camera.position.distanceTo(this.controls.target), Math.max(radius * 32, this.payload.view.radius / 4));
    this.fly(aim.clone().addScaledVector(outward, distance), aim, true);
  }

  private fly(position: three.Vector3, target: three.Vector3, smooth: boolean): void {
    if (!smooth || matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.flight = null;
      this.camera.position.copy(position);
      this.controls.target.copy(target);
      this.controls.update();
      this.draw();
      return;
    }
    const from: [three.Vector3, three.Vector3] = [this.camera.position.clone(), this.controls.target.clone()];
    this.flight = { from, to: [position, target], start: performance.now() };
    this.draw();
  }

  private draw(): void {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame((now) => {
      this.pending = false;
      this.step(now);
      this.lamp.position.copy(this.camera.position).add(new three.Vector3(0, 0, this.payload.view.radius));
      this.lamp.target.position.copy(this.controls.target);
      this.lamp.target.updateMatrixWorld();
      this.halo.quaternion.copy(this.camera.quaternion);
      this.renderer.render(this.world, this.camera);
      this.controls.update();
    });
  }

  private step(now: number): void {
    if (!this.flight) return;
    const t = Math.min((now - this.flight.start) / 450, 1);
    const eased = 1 - (1 - Math.max(t, 0)) ** 3;
    this.camera.position.lerpVectors(this.flight.from[0], this.flight.to[0], eased);
    this.controls.target.lerpVectors(this.flight.from[1], this.flight.to[1], eased);
    this.camera.lookAt(this.controls.target);
    if (t >= 1) this.flight = null;
    else this.draw();
  }

  private listen(): void {
    const canvas = this.renderer.domElement;
    let down: { x: number; y: number } | null = null;
    canvas.addEventListener("pointerdown", (event) => (down = event.isPrimary ? { x: event.clientX, y: event.clientY } : null));
    canvas.addEventListener("pointerup", (event) => {
      if (down && Math.hypot(event.clientX - down.x, event.clientY - down.y) < CLICK_PX) this.onPick(this.pick(event));
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
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private pick(event: PointerEvent): number | null {
    if (!this.layers.fruits.visible) return null;
    const { offsetX, offsetY } = event;
    const pointer = new three.Vector2((2 * offsetX) / this.box.clientWidth - 1, 1 - (2 * offsetY) / this.box.clientHeight);
    const caster = new three.Raycaster();
    caster.setFromCamera(pointer, this.camera);
    const slack = event.pointerType === "touch" ? (FINGER_PX * three.MathUtils.degToRad(FOV_DEG)) / this.box.clientHeight : 0;
    return this.balls.hit(caster.ray, slack);
  }

  private hover(event: PointerEvent): void {
    const index = this.pick(event);
    const name = index === null ? this.cameraNear(event.offsetX, event.offsetY) : `Fruit ${this.fruits[index]!.id}`;
    this.renderer.domElement.style.cursor = index === null ? "grab" : "pointer";
    this.onHover(name, event.offsetX, event.offsetY);
  }

  private cameraNear(x: number, y: number): string | null {
    if (!this.layers.cameras.visible) return null;
    let nearest = 10;
    let name: string | null = null;
    for (let i = 0; i < this.frusta.count; i++) {
      const at = this.frusta.center(i).project(this.camera);
      if (at.z > 1) continue;
      const away = Math.hypot(((at.x + 1) / 2) * this.box.clientWidth - x, ((1 - at.y) / 2) * this.box.clientHeight - y);
      if (away < nearest) [nearest, name] = [away, this.payload.cameras.names[i]!];
    }
    return name;
  }
}
