/** The row on the ground: its axis with metres written along it, and a post with its number at each tree. */

import * as three from "three";
import type { SurveyData } from "./contract";
import { short } from "./locale";

const COLOUR = 0x8a6d3b;
const MOST_LABELS = 12;
/** Of so many trees at most the number is written. */
const MOST_TREES = 10;
/** Height of a label at distance 1. */
const LABEL = 0.026;
/** Steps between marks, in cells of the grid. */
const STEPS = [1, 2, 4, 10, 20, 50, 100];

/** Places of marks along the row, from its start on, and how far they are from there. */
export function marks(start: number, end: number, grid: number): number[] {
  const cells = (end - start) / grid;
  const step = grid * (STEPS.find((s) => cells / s < MOST_LABELS) ?? Math.ceil(cells / MOST_LABELS));
  return Array.from({ length: Math.floor((end - start) / step + 1e-9) + 1 }, (_, i) => i * step);
}

/** Where a label is in the picture: its middle and its size, in any unit. */
export interface Place {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** Which labels can be read: those that lie over none of the readable ones before them. */
export function readable(places: Place[]): boolean[] {
  const kept: Place[] = [];
  return places.map((place) => {
    const free = kept.every((other) => Math.abs(other.x - place.x) * 2 >= other.width + place.width || Math.abs(other.y - place.y) * 2 >= other.height + place.height);
    if (free) kept.push(place);
    return free;
  });
}

/** Hide the labels of a row that would lie over others, as a camera sees them. */
export function thinLabels(group: three.Object3D, camera: three.PerspectiveCamera): void {
  camera.updateMatrixWorld();
  const { elements } = camera.projectionMatrix;
  const labels = group.children.filter((child) => child instanceof three.Sprite);
  // As large from near as from afar: see `text`.
  const places = labels.map(({ position, scale }) => ({ seen: position.clone().project(camera), width: scale.x * elements[0]!, height: scale.y * elements[5]! }));
  const inFront = places.map(({ seen }) => seen.z < 1);
  const free = readable(places.filter((_, i) => inFront[i]).map(({ seen, width, height }) => ({ x: seen.x, y: seen.y, width, height })));
  let next = 0;
  labels.forEach((label, i) => (label.visible = inFront[i]! && free[next++]!));
}

export function row(data: SurveyData): three.Object3D {
  const { along, across, row: ends, ground, grid, radius, high } = data.view;
  const size = radius / 14;
  const at = (t: number, z = ground): three.Vector3 => new three.Vector3(along[0] * t, along[1] * t, z);
  const lines = [at(ends[0]), at(ends[1])];
  const group = new three.Group();
  for (const far of marks(ends[0], ends[1], grid)) {
    const place = at(ends[0] + far);
    lines.push(place, place.clone().setZ(ground + size / 3));
    const label = text(`${short(far)} ${data.unit}`);
    // In front of the axis, where most cameras are.
    label.position.copy(place).addScaledVector(new three.Vector3().fromArray(across), size);
    group.add(label);
  }
  const { places } = data.trees;
  const every = Math.ceil(data.trees.ids.length / MOST_TREES);
  data.trees.ids.forEach((id, i) => {
    const foot = new three.Vector3().fromArray(places, 3 * i);
    const top = foot.clone().setZ(high);
    lines.push(foot, top);
    if (i % every) return;
    const label = text(`tree ${id}`);
    label.position.copy(top).setZ(high + size);
    group.add(label);
  });
  group.add(new three.LineSegments(new three.BufferGeometry().setFromPoints(lines), new three.LineBasicMaterial({ color: COLOUR })));
  return group;
}

/** Text that turns to the viewer and is as large from near as from afar. */
function text(words: string): three.Sprite {
  const canvas = document.createElement("canvas");
  const pen = canvas.getContext("2d")!;
  const font = "600 40px system-ui, sans-serif";
  pen.font = font;
  canvas.width = Math.ceil(pen.measureText(words).width) + 16;
  canvas.height = 56;
  pen.font = font;
  pen.textBaseline = "middle";
  // Readable on light and on dark paper.
  pen.fillStyle = "#9a7a44";
  pen.fillText(words, 8, 30);
  const texture = new three.CanvasTexture(canvas);
  texture.colorSpace = three.SRGBColorSpace;
  const sprite = new three.Sprite(new three.SpriteMaterial({ map: texture, depthWrite: false, sizeAttenuation: false }));
  sprite.scale.set((LABEL * canvas.width) / canvas.height, LABEL, 1);
  return sprite;
}
