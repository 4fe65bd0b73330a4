/** The data that Python's `report/contract.py` describes, decoded: fruits, photos, sightings, detections. */

import type { DetectionColumns, SurveyData } from "./contract";

export interface Fruit {
  index: number;
  id: number;
  x: number;
  y: number;
  z: number;
  /** NaN where it was not measured, as the two that follow. */
  diameter: number;
  diameterSd: number;
  weight: number;
  score: number;
  views: number;
  side: string;
  tree: number;
  reason: string;
}

/** A photo that has a place. `center` and `rotation` (row by row, camera from world) are in the view's frame. */
export interface Photo {
  index: number;
  name: string;
  side: string;
  width: number;
  height: number;
  center: [number, number, number];
  rotation: Float32Array;
  /** fx, fy, cx, cy in pixels. */
  lens: Float32Array;
  file: string;
}

/** x, y, width, height in pixels of a photo. */
export type Box = [number, number, number, number];

/** One photo's view of one fruit. */
export interface Sighting {
  fruit: number;
  photo: number;
  detection: number;
  box: Box;
  /** JPEG in base64; empty where the page does not carry it. */
  crop: string;
}

/** One fruit as found in one photo. `fruit` is the id of what it became, 0 for nothing. */
export interface Detection {
  id: number;
  photo: number;
  fruit: number;
  score: number;
  /** x and y of each point in turn, pixels. */
  outline: Float32Array;
}

function bytes(text: string): ArrayBuffer {
  const binary = atob(text);
  const decoded = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) decoded[i] = binary.charCodeAt(i);
  return decoded.buffer;
}

export const decodeU8 = (text: string): Uint8Array => new Uint8Array(bytes(text));
export const decodeU16 = (text: string): Uint16Array => new Uint16Array(bytes(text));
export const decodeU32 = (text: string): Uint32Array => new Uint32Array(bytes(text));
export const decodeF32 = (text: string): Float32Array => new Float32Array(bytes(text));

export function decodeFruits(data: SurveyData): Fruit[] {
  const { ids, sides, trees, reasons } = data.fruits;
  const centers = decodeF32(data.fruits.centers);
  const [diameters, sds, weights, scores] = [data.fruits.diameters, data.fruits.diameterSds, data.fruits.weights, data.fruits.scores].map(decodeF32) as [
    Float32Array, Float32Array, Float32Array, Float32Array,
  ];
  const views = decodeU32(data.fruits.views);
  return ids.map((id, i) => ({
    index: i,
    id,
    x: centers[3 * i]!,
    y: centers[3 * i + 1]!,
    z: centers[3 * i + 2]!,
    diameter: diameters[i]!,
    diameterSd: sds[i]!,
    weight: weights[i]!,
    score: scores[i]!,
    views: views[i]!,
    side: sides[i] ?? "",
    tree: trees[i] ?? 0,
    reason: reasons[i] ?? "",
  }));
}

export function decodePhotos(data: SurveyData): Photo[] {
  const { names, sides, widths, heights, files } = data.photos;
  const frusta = decodeF32(data.photos.frusta);
  const rotations = decodeF32(data.photos.rotations);
  const lenses = decodeF32(data.photos.lenses);
  return names.map((name, i) => ({
    index: i,
    name,
    side: sides[i] ?? "",
    width: widths[i]!,
    height: heights[i]!,
    center: [frusta[15 * i]!, frusta[15 * i + 1]!, frusta[15 * i + 2]!],
    rotation: rotations.subarray(9 * i, 9 * i + 9),
    lens: lenses.subarray(4 * i, 4 * i + 4),
    file: files[i] ?? "",
  }));
}

/** For each fruit its sightings, the largest first. */
export function decodeSightings(data: SurveyData): Sighting[][] {
  const fruits = decodeU32(data.sightings.fruits);
  const photos = decodeU32(data.sightings.photos);
  const detections = decodeU32(data.sightings.detections);
  const boxes = decodeF32(data.sightings.boxes);
  const seen: Sighting[][] = data.fruits.ids.map(() => []);
  fruits.forEach((fruit, i) => {
    const box = [...boxes.subarray(4 * i, 4 * i + 4)] as Box;
    seen[fruit]?.push({ fruit, photo: photos[i]!, detection: detections[i]!, box, crop: data.sightings.crops[i] ?? "" });
  });
  return seen;
}

export function decodeDetections(columns: DetectionColumns): Detection[] {
  const [photos, fruits, starts] = [decodeU32(columns.photos), decodeU32(columns.fruits), decodeU32(columns.starts)];
  const [scores, points] = [decodeF32(columns.scores), decodeF32(columns.points)];
  return Array.from(decodeU32(columns.ids), (id, i) => ({
    id,
    photo: photos[i]!,
    fruit: fruits[i]!,
    score: scores[i]!,
    outline: points.subarray(2 * starts[i]!, 2 * starts[i + 1]!),
  }));
}

export function median(values: number[]): number {
  const finite = values.filter(Number.isFinite).sort((a, b) => a - b);
  return finite.length ? finite[finite.length >> 1]! : NaN;
}

/** The share `q` of the values is not larger; 0 of none. */
export function quantile(values: number[], q: number): number {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
  return sorted[Math.round(q * (sorted.length - 1))] ?? 0;
}
