/** The 3D data of a report, as Python's `report/scene.py` writes it, and its decoding. */

export interface PackedCloud {
  count: number;
  /** Lower corner and extent of the box that the 16-bit positions divide. */
  min: [number, number, number];
  size: [number, number, number];
  positions: string;
  colours: string;
}

export interface Payload {
  unit: string;
  metric: boolean;
  scene: PackedCloud;
  fruitPoints: PackedCloud;
  fruits: { ids: number[]; centers: string; diameters: string; scores: string; views: string; sides: string[]; trees: number[] };
  cameras: { names: string[]; frusta: string };
  sightings: { fruits: string; cameras: string };
  view: { target: number[]; radius: number; along: number[]; toward: number[]; ground: number; grid: number };
}

export interface Fruit {
  index: number;
  id: number;
  x: number;
  y: number;
  z: number;
  /** NaN where it was not measured. */
  diameter: number;
  score: number;
  views: number;
  side: string;
  tree: number;
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

export function decodeFruits(payload: Payload): Fruit[] {
  const { ids, sides, trees } = payload.fruits;
  const centers = decodeF32(payload.fruits.centers);
  const diameters = decodeF32(payload.fruits.diameters);
  const scores = decodeF32(payload.fruits.scores);
  const views = decodeU32(payload.fruits.views);
  return ids.map((id, i) => ({
    index: i,
    id,
    x: centers[3 * i]!,
    y: centers[3 * i + 1]!,
    z: centers[3 * i + 2]!,
    diameter: diameters[i]!,
    score: scores[i]!,
    views: views[i]!,
    side: sides[i] ?? "",
    tree: trees[i] ?? 0,
  }));
}

/** For each fruit the indices of the cameras that saw it. */
export function decodeSightings(payload: Payload): number[][] {
  const fruits = decodeU32(payload.sightings.fruits);
  const cameras = decodeU32(payload.sightings.cameras);
  const seen: number[][] = payload.fruits.ids.map(() => []);
  fruits.forEach((fruit, i) => seen[fruit]?.push(cameras[i]!));
  return seen;
}

export function median(values: number[]): number {
  const finite = values.filter(Number.isFinite).sort((a, b) => a - b);
  return finite.length ? finite[finite.length >> 1]! : NaN;
}
