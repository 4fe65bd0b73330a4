/** A cloud of points: pieces that come one after the other, each an even sample of the whole. */

import * as three from "three";
import type { PackedCloud, ViewHints } from "./contract";

const VERTEX = `
attribute float bits;
uniform float size;
uniform float halfHeight;
uniform vec2 limits;
varying vec3 tint;
#include <clipping_planes_pars_vertex>
void main() {
  vec4 mvPosition = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * mvPosition;
  gl_PointSize = clamp(size * projectionMatrix[1][1] * halfHeight / max(-mvPosition.z, 1e-6), limits.x, limits.y);
  float colour = floor(bits * 65535.0 + 0.5);
  tint = vec3(floor(colour / 2048.0), mod(floor(colour / 32.0), 64.0), mod(colour, 32.0)) / vec3(31.0, 63.0, 31.0);
  #include <clipping_planes_vertex>
}`;

// Colours are those of the screen already.
const FRAGMENT = `
varying vec3 tint;
#include <clipping_planes_pars_fragment>
void main() {
  #include <clipping_planes_fragment>
  if (length(gl_PointCoord - 0.5) > 0.53) discard;
  gl_FragColor = vec4(tint, 1.0);
}`;

/** The least and the most that a point covers. */
const POINT_PX = new three.Vector2(2, 7);
const STEPS = 65535;
/** Pieces but the first are on a layer of their own, so that they can be drawn over the picture one by one. */
export const LATER = 1;

/** Points as large as their distance from each other, if they lay evenly on the row's front. */
export function pointSize(count: number, { row, low, high, radius }: Pick<ViewHints, "row" | "low" | "high" | "radius">): number {
  const apart = Math.sqrt(((row[1] - row[0]) * (high - low)) / Math.max(count, 1));
  return Math.min(Math.max(1.6 * apart, radius / 2000), radius / 40);
}

export class PointCloud {
  readonly object = new three.Group();
  private readonly pieces: three.Points[] = [];
  private readonly arrays: Uint16Array[] = [];
  private readonly material: three.ShaderMaterial;
  private asked = false;

  /** `more` gets the pieces that are not in the data, `onMore` is told of each. */
  constructor(private readonly cloud: PackedCloud, view: ViewHints, private readonly more: (piece: number) => Promise<Uint16Array>, private readonly onMore: (piece: three.Points) => void) {
    this.material = new three.ShaderMaterial({
      vertexShader: VERTEX, fragmentShader: FRAGMENT, clipping: true,
      uniforms: { size: { value: pointSize(cloud.count, view) }, halfHeight: { value: 1 }, limits: { value: new three.Vector2() } },
    });
    this.object.position.fromArray(cloud.min);
    this.object.scale.fromArray(cloud.size);
    if (cloud.count) this.add(cloud.points);
  }

  /** Those pieces that are drawn after the others, one by one. */
  get later(): three.Points[] {
    return this.object.visible ? this.pieces.slice(1) : [];
  }

  /** How many points of the first piece are drawn. */
  limit(points: number): void {
    this.pieces[0]?.geometry.setDrawRange(0, points);
  }

  clip(planes: three.Plane[]): void {
    this.material.clippingPlanes = planes;
  }

  /** Get the pieces that are not here yet. */
  async load(): Promise<void> {
    const each = this.cloud.points.length / 4;
    if (this.asked || !each) return;
    this.asked = true;
    for (let piece = 1; piece * each < this.cloud.count; piece++) {
      this.onMore(this.add(await this.more(piece)));
    }
  }

  /** The point that a ray meets first, within `slack` radians of it; null where there is none. */
  hit(ray: three.Ray, slack: number): three.Vector3 | null {
    if (!this.object.visible) return null;
    const { min, size } = this.cloud;
    const { origin: from, direction: to } = ray;
    const [sx, sy, sz] = size.map((extent) => extent / STEPS) as [number, number, number];
    const [ox, oy, oz] = [min[0] - from.x, min[1] - from.y, min[2] - from.z];
    let nearest = Infinity;
    let found: three.Vector3 | null = null;
    for (const points of this.arrays) {
      for (let i = 0; i < points.length; i += 4) {
        const [x, y, z] = [ox + sx * points[i]!, oy + sy * points[i + 1]!, oz + sz * points[i + 2]!];
        const along = x * to.x + y * to.y + z * to.z;
        if (along <= 0 || along >= nearest) continue;
        if (x * x + y * y + z * z - along * along > (along * slack) ** 2) continue;
        const place = new three.Vector3(x, y, z).add(from);
        if (this.material.clippingPlanes?.some((plane) => plane.distanceToPoint(place) < 0)) continue;
        nearest = along;
        found = place;
      }
    }
    return found;
  }

  private add(points: Uint16Array): three.Points {
    const buffer = new three.InterleavedBuffer(points, 4);
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.InterleavedBufferAttribute(buffer, 3, 0, true));
    geometry.setAttribute("bits", new three.InterleavedBufferAttribute(buffer, 1, 3, true));
    const piece = new three.Points(geometry, this.material);
    piece.frustumCulled = false;
    geometry.boundingSphere = new three.Sphere(new three.Vector3(0.5, 0.5, 0.5), 1);
    const drawn = new three.Vector2();
    piece.onBeforeRender = (renderer) => {
      const { halfHeight, limits } = this.material.uniforms;
      halfHeight!.value = renderer.getDrawingBufferSize(drawn).y / 2;
      (limits!.value as three.Vector2).copy(POINT_PX).multiplyScalar(renderer.getPixelRatio());
    };
    if (this.pieces.length) piece.layers.set(LATER);
    this.pieces.push(piece);
    this.arrays.push(points);
    this.object.add(piece);
    return piece;
  }
}
