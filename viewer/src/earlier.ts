/** Fruits of an earlier survey beside those of now: joined where they are the same, and how these have grown. */

import * as three from "three";
import { Balls } from "./balls";
import { byNumber, type Colouring, type Rgb } from "./colours";
import type { EarlierFruits } from "./contract";

const GONE: Rgb = [0.13, 0.4, 0.85];
const OUT_OF_VIEW: Rgb = [0.55, 0.55, 0.55];
const SAME: Rgb = [0.16, 0.6, 0.33];
const NEW: Rgb = [0.95, 0.6, 0.05];
const JOINS = 0x35d0ff;

export function earlierFruits(earlier: EarlierFruits, centers: Float32Array): three.Group {
  const balls = new Balls(earlier.centers);
  balls.size((i) => earlier.diameters[i]! / 2);
  balls.colour((i) => (earlier.later[i]! >= 0 ? SAME : earlier.inView[i] ? GONE : OUT_OF_VIEW));
  const ends = earlier.later.flatMap((now, i) => (now < 0 ? [] : [...earlier.centers.subarray(3 * i, 3 * i + 3), ...centers.subarray(3 * now, 3 * now + 3)]));
  const lines = new three.BufferGeometry();
  lines.setAttribute("position", new three.BufferAttribute(Float32Array.from(ends), 3));
  const group = new three.Group();
  group.add(balls.object, new three.LineSegments(lines, new three.LineBasicMaterial({ color: JOINS, depthTest: false, transparent: true })));
  return group;
}

/** Which fruits were there before, in which colour. */
export function byChange(earlier: EarlierFruits): Colouring {
  const same = new Set(earlier.later);
  return { of: ({ index }) => (same.has(index) ? SAME : NEW), categories: [["in both", SAME], ["new", NEW], ["gone", GONE], ["out of view", OUT_OF_VIEW]] };
}

export function byGrowth(earlier: EarlierFruits): Colouring {
  return byNumber([...earlier.growth], ({ index }) => earlier.growth[index]!);
}
