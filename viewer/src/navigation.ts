/** Where one stands: turning, flying, the named looks, and standing where a photo was taken from. */

import * as three from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { SurveyData } from "./contract";
import { quantile, type Fruit, type Photo } from "./payload";

export type Look = "photos" | "front" | "back" | "side" | "top";

const FOV_DEG = 42;
const FLIGHT_MS = 450;
/** Seconds for the length of a radius when flying along the row. */
const ALONG_S = 4;
const UP = new three.Vector3(0, 0, 1);

/** Where a picture lies in the view, in pixels. */
export interface Placed {
  left: number;
  top: number;
  width: number;
  height: number;
}

/**
 * Where a photo without distortion lies over a view through its camera, and how high an angle (degrees) the view has.
 *
 * The whole photo is in sight. Where its pixels are wider than high, or its focal lengths differ, it is drawn so that
 * both agree, as the view's pixels are square.
 */
export function throughLens({ width, height, lens }: Pick<Photo, "width" | "height" | "lens">, viewWidth: number, viewHeight: number): { place: Placed; fov: number } {
  const [fx, fy, cx, cy] = lens as unknown as [number, number, number, number];
  const wider = fy / fx;
  const scale = Math.min(viewWidth / (width * wider), viewHeight / height);
  const place = { left: viewWidth / 2 - cx * scale * wider, top: viewHeight / 2 - cy * scale, width: width * scale * wider, height: height * scale };
  return { place, fov: 2 * three.MathUtils.radToDeg(Math.atan(viewHeight / (2 * fy * scale))) };
}

export class Navigation {
  readonly camera: three.PerspectiveCamera;
  readonly controls: OrbitControls;
  /** The photo through whose camera one looks. */
  through: Photo | null = null;
  onLeave: () => void = () => {};

  private flight: { from: [three.Vector3, three.Vector3]; to: [three.Vector3, three.Vector3]; start: number } | null = null;
  private along: { direction: number; last: number } | null = null;
  private readonly places: three.Vector3[];

  constructor(canvas: HTMLElement, private readonly box: HTMLElement, private readonly data: SurveyData, fruits: Fruit[], swings: boolean, private readonly draw: () => void) {
    const { radius } = data.view;
    this.places = fruits.map(({ x, y, z }) => new three.Vector3(x, y, z));
    this.camera = new three.PerspectiveCamera(FOV_DEG, 1, radius / 500, radius * 60);
    this.camera.up.copy(UP);
    this.controls = new OrbitControls(this.camera, canvas);
    // A motion that fades takes a number of pictures; where each takes long, it would go on for seconds.
    this.controls.enableDamping = swings;
    this.controls.dampingFactor = 0.12;
    this.controls.zoomToCursor = true;
    this.controls.minDistance = radius / 100;
    this.controls.maxDistance = radius * 20;
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => {
      this.flight = null;
      this.along = null;
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("pointermove", (event) => {
      if (this.through && event.buttons) this.leave();
    });
  }

  /** Look at the fruits: from where the photos saw them, from the row's sides or end, or from above. */
  look(from: Look, smooth = true): void {
    const { toward, across, along } = this.data.view;
    const outward = new three.Vector3().fromArray(across);
    const directions: Record<Look, three.Vector3> = {
      photos: new three.Vector3().fromArray(toward),
      front: outward,
      back: outward.clone().negate(),
      side: new three.Vector3().fromArray(along).negate(),
      // Not quite straight down, so that the row's front stays in front.
      top: outward.clone().multiplyScalar(0.02).add(UP),
    };
    const { eye, target } = this.fit(directions[from].normalize());
    this.fly(eye, target, smooth);
  }

  flyTo(aim: three.Vector3, radius: number): void {
    this.leave();
    const outward = this.camera.position.clone().sub(this.controls.target).normalize();
    const { high, low, radius: whole } = this.data.view;
    // Near enough in a long row, too, which is as high as a short one.
    const near = Math.min(whole / 4, high - low);
    const distance = Math.min(this.camera.position.distanceTo(this.controls.target), Math.max(radius * 32, near));
    this.fly(aim.clone().addScaledVector(outward, distance), aim, true);
  }

  /** Start or stop moving along the row; returns whether it moves. Where no motion is wanted, one step. */
  flyAlong(): boolean {
    this.leave();
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.move(this.data.view.radius / 4);
    else this.along = this.along ? null : { direction: 1, last: performance.now() };
    this.draw();
    return this.along !== null;
  }

  get flies(): boolean {
    return this.along !== null;
  }

  /** Stand where a photo was taken from; returns where the photo then lies in the view, in pixels. */
  lookThrough(photo: Photo): Placed {
    this.flight = null;
    this.along = null;
    this.through = photo;
    this.controls.enabled = false;
    const { place, fov } = throughLens(photo, this.box.clientWidth, this.box.clientHeight);
    const r = photo.rotation as unknown as number[];
    // Three's cameras look along their −z with y up, photos' along z with y down.
    const basis = new three.Matrix4().makeBasis(
      new three.Vector3(r[0], r[1], r[2]), new three.Vector3(-r[3]!, -r[4]!, -r[5]!), new three.Vector3(-r[6]!, -r[7]!, -r[8]!),
    );
    this.camera.position.fromArray(photo.center);
    this.camera.quaternion.setFromRotationMatrix(basis);
    this.camera.fov = fov;
    this.camera.updateProjectionMatrix();
    this.draw();
    return place;
  }

  /** Stand and look somewhere, at once. */
  stand(eye: [number, number, number], target: [number, number, number]): void {
    this.fly(new three.Vector3(...eye), new three.Vector3(...target), false);
  }

  /** Stand free again, where one is. */
  leave(): void {
    if (!this.through) return;
    const ahead = new three.Vector3();
    this.camera.getWorldDirection(ahead);
    const middle = this.camera.position.clone().negate().dot(ahead);
    this.controls.target.copy(this.camera.position).addScaledVector(ahead, Math.max(middle, this.data.view.radius / 4));
    this.through = null;
    this.camera.fov = FOV_DEG;
    this.camera.updateProjectionMatrix();
    this.controls.enabled = true;
    this.onLeave();
    this.draw();
  }

  resize(aspect: number): void {
    this.camera.aspect = aspect;
    this.camera.updateProjectionMatrix();
  }

  /** Before each picture. */
  step(now: number): void {
    if (this.through) return;
    if (this.along) {
      const seconds = Math.min((now - this.along.last) / 1000, 0.1);
      this.along.last = now;
      this.move(Math.max(seconds, 0) * (this.data.view.radius / ALONG_S));
      this.draw();
    }
    if (this.flight) {
      const t = Math.min(Math.max(now - this.flight.start, 0) / FLIGHT_MS, 1);
      const eased = 1 - (1 - t) ** 3;
      this.camera.position.lerpVectors(this.flight.from[0], this.flight.to[0], eased);
      this.controls.target.lerpVectors(this.flight.from[1], this.flight.to[1], eased);
      this.camera.lookAt(this.controls.target);
      if (t >= 1) this.flight = null;
      this.draw();
    } else this.controls.update();
  }

  /** Where to stand so that nearly all fruits are in the picture, looking against `direction`. */
  private fit(direction: three.Vector3): { eye: three.Vector3; target: three.Vector3 } {
    const right = new three.Vector3().crossVectors(UP, direction).normalize();
    const up = new three.Vector3().crossVectors(direction, right);
    const a = this.places.map((place) => place.dot(right));
    const b = this.places.map((place) => place.dot(up));
    const depth = this.places.map((place) => place.dot(direction));
    const [aMiddle, bMiddle] = [a, b].map((values) => (quantile(values, 0.02) + quantile(values, 0.98)) / 2) as [number, number];
    const tan = Math.tan(three.MathUtils.degToRad(FOV_DEG / 2));
    // The tools cover the top of the picture.
    const needed = depth.map((d, i) => d + Math.max(Math.abs(a[i]! - aMiddle) / (tan * Math.max(this.camera.aspect, 0.2)), Math.abs(b[i]! - bMiddle) / (0.8 * tan)));
    const { radius } = this.data.view;
    const distance = this.places.length > 2 ? Math.max(quantile(needed, 0.95) * 1.06, radius / 3) : radius / tan;
    const target = right.multiplyScalar(aMiddle).addScaledVector(up, bMiddle);
    return { eye: target.clone().addScaledVector(direction, distance), target };
  }

  private fly(position: three.Vector3, target: three.Vector3, smooth: boolean): void {
    this.leave();
    this.along = null;
    if (!smooth || matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.flight = null;
      this.camera.position.copy(position);
      this.controls.target.copy(target);
      this.controls.update();
    } else {
      this.flight = { from: [this.camera.position.clone(), this.controls.target.clone()], to: [position, target], start: performance.now() };
    }
    this.draw();
  }

  /** Move along the row, back again at its end. */
  private move(distance: number): void {
    const axis = new three.Vector3().fromArray(this.data.view.along);
    const at = this.controls.target.dot(axis);
    const [start, end] = this.data.view.row;
    if (this.along && (at > end || at < start)) this.along.direction = at > end ? -1 : 1;
    const by = axis.multiplyScalar(distance * (this.along?.direction ?? (at > end ? -(end - start) / distance : 1)));
    this.camera.position.add(by);
    this.controls.target.add(by);
  }

  private key(event: KeyboardEvent): void {
    const turn = Math.PI / 24;
    const act: Record<string, () => void> = {
      ArrowLeft: () => this.orbit(-turn, 0), ArrowRight: () => this.orbit(turn, 0), ArrowUp: () => this.orbit(0, -turn), ArrowDown: () => this.orbit(0, turn),
      "+": () => this.zoom(0.85), "=": () => this.zoom(0.85), "-": () => this.zoom(1 / 0.85), Home: () => this.look("photos"),
    };
    const does = act[event.key];
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.leave();
    does();
  }

  private orbit(sideways: number, upward: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target).applyAxisAngle(UP, sideways);
    const right = new three.Vector3().crossVectors(UP, offset).normalize();
    const turned = offset.clone().applyAxisAngle(right, upward);
    if (Math.abs(turned.clone().normalize().z) < 0.99) offset.copy(turned);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.draw();
  }

  private zoom(factor: number): void {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.draw();
  }
}
