/** Photos in the frusta of their cameras: small copies, got once the picture stands still, and never more than a few dozen. */

import * as three from "three";
import type { Frusta } from "./layers";

/** So many pictures are kept, of at most 256 pixels: 16 MB of a graphics card. */
export const MOST = 64;
/** Smaller on the screen, a photo shows nothing. */
const LEAST_PX = 14;
/** Pictures come one after the other; so often, those that came are drawn. */
const PACE_MS = 600;

/** Cameras whose frusta are large enough on the screen, the nearest first. `size_px` (n): NaN where it is not to be seen. */
export function wanted(sizes: ArrayLike<number>, most = MOST): number[] {
  const all = Array.from({ length: sizes.length }, (_, i) => i).filter((i) => sizes[i]! >= LEAST_PX);
  return all.sort((a, b) => sizes[b]! - sizes[a]!).slice(0, most);
}

export class FramedPhotos {
  readonly object = new three.Group();
  private readonly there = new Map<number, three.Mesh<three.BufferGeometry, three.MeshBasicMaterial>>();
  private readonly failed = new Set<number>();
  private asked: number[] = [];
  private coming: number | null = null;
  private drawnAt = 0;

  constructor(private readonly frusta: Frusta, private readonly url: (camera: number) => string | null, private readonly onCame: () => void) {}

  /** Whether pictures that are wanted are not here yet. */
  get comes(): boolean {
    return this.coming !== null;
  }

  /** Show these cameras' photos, in this order as far as they are not here yet; others may go. */
  want(cameras: number[]): void {
    this.asked = cameras.filter((camera) => camera !== this.coming && !this.there.has(camera) && !this.failed.has(camera));
    const stay = new Set(cameras);
    for (const [camera, mesh] of this.there) {
      if (stay.has(camera) || this.there.size + this.asked.length <= MOST) continue;
      mesh.material.map!.dispose();
      mesh.material.dispose();
      mesh.geometry.dispose();
      this.object.remove(mesh);
      this.there.delete(camera);
    }
    if (this.coming === null) void this.get();
  }

  private async get(): Promise<void> {
    for (let camera = this.asked.shift(); camera !== undefined; camera = this.asked.shift()) {
      this.coming = camera;
      const url = this.url(camera);
      try {
        if (url === null) throw new Error("no photo");
        const image = new Image();
        image.src = url;
        await image.decode();
        this.add(camera, image);
      } catch {
        this.failed.add(camera);
      }
      if (performance.now() - this.drawnAt > PACE_MS || !this.asked.length) {
        this.drawnAt = performance.now();
        this.onCame();
      }
    }
    this.coming = null;
  }

  private add(camera: number, image: HTMLImageElement): void {
    const texture = new three.Texture(image);
    texture.colorSpace = three.SRGBColorSpace;
    texture.generateMipmaps = false;
    texture.minFilter = three.LinearFilter;
    texture.needsUpdate = true;
    const geometry = new three.BufferGeometry();
    // The photo's corners: top left, then clockwise.
    geometry.setAttribute("position", new three.BufferAttribute(this.frusta.corners.slice(15 * camera + 3, 15 * camera + 15), 3));
    geometry.setAttribute("uv", new three.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
    geometry.setIndex([0, 2, 1, 0, 3, 2]);
    const material = new three.MeshBasicMaterial({ map: texture, side: three.DoubleSide, toneMapped: false });
    const mesh = new three.Mesh(geometry, material);
    this.there.set(camera, mesh);
    this.object.add(mesh);
  }
}
