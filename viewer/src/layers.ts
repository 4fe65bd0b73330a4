/** What can be seen in the 3D view beside points: fruits, cameras, sight lines, ground. */

import * as three from "three";
import { Balls } from "./balls";
import { drawnRadii, type Colouring } from "./colours";
import type { SurveyData } from "./contract";
import type { Fruit } from "./payload";

const CAMERA_COLOUR = 0x5b7fa6;
const SIGHT_COLOUR = 0xe8960c;

export class FruitBalls {
  readonly object: three.Object3D;
  readonly radii: Float32Array;
  private readonly balls: Balls;
  private shown: boolean[];

  constructor(private readonly fruits: Fruit[], centers: Float32Array) {
    this.shown = fruits.map(() => true);
    this.radii = drawnRadii(fruits);
    this.balls = new Balls(centers);
    this.object = this.balls.object;
    this.show(this.shown);
  }

  /** Show some of the fruits; the others can neither be seen nor clicked. */
  show(shown: boolean[]): void {
    this.shown = shown;
    this.balls.size((i) => (shown[i] ? this.radii[i]! : 0));
  }

  /** See-through balls show the points in them. */
  seeThrough(yes: boolean): void {
    this.balls.seeThrough(yes ? 0.35 : 1);
  }

  colour(colouring: Colouring): void {
    this.balls.colour((i) => colouring.of(this.fruits[i]!));
  }

  /** The nearest fruit that a ray meets; `slack` (radians) widens small fruits for fingers. */
  hit(ray: three.Ray, slack: number): number | null {
    let best: number | null = null;
    let nearest = Infinity;
    const center = new three.Vector3();
    this.fruits.forEach((fruit, i) => {
      if (!this.shown[i]) return;
      center.set(fruit.x, fruit.y, fruit.z).sub(ray.origin);
      const along = center.dot(ray.direction);
      if (along <= 0 || along >= nearest) return;
      const off = Math.sqrt(Math.max(0, center.lengthSq() - along * along));
      if (off > Math.max(this.radii[i]!, along * slack)) return;
      nearest = along;
      best = i;
    });
    return best;
  }
}

/** Each camera as a small frustum: five points, the centre and the photo's corners (top left, then clockwise). */
export class Frusta {
  readonly object: three.LineSegments;
  readonly corners: Float32Array;
  readonly count: number;

  constructor(data: SurveyData) {
    this.corners = data.photos.frusta;
    this.count = data.photos.names.length;
    const edges = [0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1];
    const index = new Uint32Array(this.count * edges.length);
    for (let i = 0; i < this.count; i++) edges.forEach((corner, k) => (index[i * edges.length + k] = 5 * i + corner));
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.BufferAttribute(this.corners, 3));
    geometry.setIndex(new three.BufferAttribute(index, 1));
    const material = new three.LineBasicMaterial({ color: CAMERA_COLOUR, transparent: true, opacity: 0.75 });
    this.object = new three.LineSegments(geometry, material);
  }

  center(i: number): three.Vector3 {
    return new three.Vector3().fromArray(this.corners, 15 * i);
  }

  /** How wide the photo is in the scene. */
  width(i: number): number {
    const [left, right] = [3, 6].map((corner) => new three.Vector3().fromArray(this.corners, 15 * i + corner));
    return left!.distanceTo(right!);
  }
}

/** From a fruit to each camera that saw it. */
export function sightLines(fruit: Fruit, cameras: number[], frusta: Frusta): three.LineSegments {
  const ends = cameras.flatMap((camera) => [new three.Vector3(fruit.x, fruit.y, fruit.z), frusta.center(camera)]);
  const material = new three.LineBasicMaterial({ color: SIGHT_COLOUR, transparent: true, opacity: 0.8 });
  return new three.LineSegments(new three.BufferGeometry().setFromPoints(ends), material);
}

/** A ring around the selected fruit that is seen through everything and turns to the viewer. */
export function halo(): three.Mesh {
  const material = new three.MeshBasicMaterial({
    color: SIGHT_COLOUR, transparent: true, depthTest: false, side: three.DoubleSide, toneMapped: false,
  });
  const ring = new three.Mesh(new three.RingGeometry(1.3, 1.5, 48), material);
  ring.renderOrder = 10;
  ring.visible = false;
  return ring;
}

export function ground(data: SurveyData): three.GridHelper {
  const { radius, ground: height, grid } = data.view;
  const cells = Math.min(200, Math.max(4, 2 * Math.ceil(radius / grid)));
  const helper = new three.GridHelper(cells * grid, cells);
  helper.material = new three.LineBasicMaterial({ color: 0x8a948c, transparent: true, opacity: 0.4 });
  helper.rotateX(Math.PI / 2);
  helper.position.set(0, 0, height);
  return helper;
}
