/** What Python's `stages/report/contract.py` describes, as objects: fruits, photos, sightings, detections. */

import type { DetectionColumns, Sightings, SurveyData } from "./contract";

export interface Fruit {
  index: number;
  id: number;
  x: number;
  y: number;
  z: number;
  /** NaN where it was not measured, as the three that follow. */
  diameter: number;
  diameterSd: number;
  visibility: number;
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
  photo: number;
  detection: number;
  box: Box;
  /** A JPEG; empty where the page does not carry it. */
  crop: Uint8Array;
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

export function fruitsOf(data: SurveyData): Fruit[] {
  const { ids, centers, diameters, diameterSds, visibilities, weights, scores, views, sides, trees, reasons } = data.fruits;
  return ids.map((id, i) => ({
    index: i,
    id,
    x: centers[3 * i]!,
    y: centers[3 * i + 1]!,
    z: centers[3 * i + 2]!,
    diameter: diameters[i]!,
    diameterSd: diameterSds[i]!,
    visibility: visibilities[i]!,
    weight: weights[i]!,
    score: scores[i]!,
    views: views[i]!,
    side: sides[i] ?? "",
    tree: trees[i] ?? 0,
    reason: reasons[i] ?? "",
  }));
}

export function photosOf(data: SurveyData): Photo[] {
  const { names, sides, widths, heights, files, frusta, rotations, lenses } = data.photos;
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

/** The sightings of one of the fruits, the largest first. */
export function sightingsOf(columns: Sightings, fruit: number): Sighting[] {
  const { starts, photos, detections, boxes, cropStarts, crops } = columns;
  const [start, end] = [starts[fruit] ?? 0, starts[fruit + 1] ?? 0];
  return Array.from({ length: end - start }, (_, k) => {
    const i = start + k;
    const box = [...boxes.subarray(4 * i, 4 * i + 4)] as Box;
    return { photo: photos[i]!, detection: detections[i]!, box, crop: crops.subarray(cropStarts[i]!, cropStarts[i + 1]!) };
  });
}

export function detectionsOf({ ids, photos, fruits, scores, starts, points }: DetectionColumns): Detection[] {
  return Array.from(ids, (id, i) => ({
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
