/** What can be seen in the 3D view: points, fruits, cameras, sight lines, ground. */

import * as three from "three";
import { drawnRadii, type Colouring } from "./colours";
import { FruitDiscs, FruitSpheres, type FruitDrawing } from "./balls";
import type { PackedCloud, SurveyData } from "./contract";
import { decodeF32, decodeU16, decodeU8, type Fruit } from "./payload";

const CAMERA_COLOUR = 0x5b7fa6;
const SIGHT_COLOUR = 0xe8960c;

/** sRGB bytes to the linear values that three.js works with. */
const LINEAR = Float32Array.from({ length: 256 }, (_, i) => new three.Color().setRGB(i / 255, 0, 0, three.SRGBColorSpace).r);

/** 0 to n − 1 in a fixed random order, so that the first points of a cloud are an even sample of it. */
export function shuffled(n: number): Uint32Array {
  const order = Uint32Array.from({ length: n }, (_, i) => i);
  let seed = 1;
  for (let i = n - 1; i > 0; i--) {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const j = Math.floor((seed / 4294967296) * (i + 1));
    [order[i], order[j]] = [order[j]!, order[i]!];
  }
  return order;
}

function reordered<T extends Uint8Array | Uint16Array>(values: T, order: Uint32Array): T {
  const result = values.slice() as T;
  order.forEach((from, to) => {
    for (let axis = 0; axis < 3; axis++) result[3 * to + axis] = values[3 * from + axis]!;
  });
  return result;
}

/** Points, as large as fills a scene of this radius without hiding it. */
export function points(cloud: PackedCloud, radius: number): three.Points {
  const geometry = new three.BufferGeometry();
  const order = shuffled(cloud.count);
  geometry.setAttribute("position", new three.BufferAttribute(reordered(decodeU16(cloud.positions), order), 3, true));
  const colours = Float32Array.from(reordered(decodeU8(cloud.colours), order), (byte) => LINEAR[byte]!);
  geometry.setAttribute("color", new three.BufferAttribute(colours, 3));
  const size = radius * Math.min(1 / 35, Math.max(1 / 180, 4 / Math.sqrt(cloud.count + 1)));
  const material = new three.PointsMaterial({ size, vertexColors: true, sizeAttenuation: true });
  material.onBeforeCompile = (shader) => {
    // Points are discs which grow as one comes near, and stay visible from afar.
    shader.vertexShader = shader.vertexShader.replace(
      "#include <logdepthbuf_vertex>",
      `gl_PointSize = clamp(gl_PointSize, ${(2 * window.devicePixelRatio).toFixed(1)}, ${(7 * window.devicePixelRatio).toFixed(1)});\n#include <logdepthbuf_vertex>`,
    );
    shader.fragmentShader = shader.fragmentShader.replace(
      "#include <clipping_planes_fragment>",
      "if (length(gl_PointCoord - 0.5) > 0.53) discard;\n#include <clipping_planes_fragment>",
    );
  };
  const object = new three.Points(geometry, material);
  object.position.fromArray(cloud.min);
  object.scale.fromArray(cloud.size);
  object.visible = cloud.count > 0;
  return object;
}

/** More fruits than this are drawn as shaded discs, which cost a point each and not a hundred faces. */
const MANY = 3000;

export class FruitBalls {
  readonly object: three.Object3D;
  readonly radii: Float32Array;
  private readonly drawn: FruitDrawing;
  private shown: boolean[];

  constructor(private readonly fruits: Fruit[]) {
    this.shown = fruits.map(() => true);
    this.radii = drawnRadii(fruits);
    this.drawn = fruits.length > MANY ? new FruitDiscs(fruits) : new FruitSpheres(fruits);
    this.object = this.drawn.object;
    this.object.frustumCulled = false;
    this.show(this.shown);
  }

  /** Show some of the fruits; the others can neither be seen nor clicked. */
  show(shown: boolean[]): void {
    this.shown = shown;
    this.drawn.size(this.radii.map((radius, i) => (shown[i] ? radius : 0)));
  }

  /** See-through balls show the points in them. */
  seeThrough(yes: boolean): void {
    this.drawn.seeThrough(yes ? 0.35 : 1);
  }

  colour(colouring: Colouring): void {
    this.drawn.colour(this.fruits.map((fruit) => colouring.of(fruit)));
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
    this.corners = decodeF32(data.photos.frusta);
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
