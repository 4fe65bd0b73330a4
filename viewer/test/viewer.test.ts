import { expect, test } from "vitest";
import { colouring, drawnRadii, ramp } from "../src/colours";
import { placed } from "../src/crop";
import type { DetectionColumns, Rates, SurveyData } from "../src/contract";
import { within } from "../src/filter";
import { decodeDetections, decodeFruits, decodeSightings, decodeU16, median, quantile } from "../src/payload";
import { shuffled } from "../src/layers";
import { marks } from "../src/row";
import { compareCells } from "../src/table";
import { stepAt } from "../src/truth";

const base64 = (values: Float32Array | Uint32Array): string => btoa(String.fromCharCode(...new Uint8Array(values.buffer)));

const survey = {
  fruits: {
    ids: [7, 3],
    centers: base64(Float32Array.of(0, 0.5, 1, -1, 2, 3)),
    diameters: base64(Float32Array.of(0.08, NaN)),
    diameterSds: base64(Float32Array.of(0.002, NaN)),
    weights: base64(Float32Array.of(NaN, NaN)),
    scores: base64(Float32Array.of(1, 0.5)),
    views: base64(Uint32Array.of(4, 2)),
    sides: ["east", ""],
    trees: [1, 0],
    reasons: ["", "seen once"],
  },
  sightings: {
    fruits: base64(Uint32Array.of(1, 0, 1)),
    photos: base64(Uint32Array.of(5, 6, 7)),
    detections: base64(Uint32Array.of(50, 60, 70)),
    boxes: base64(Float32Array.of(0, 0, 9, 9, 1, 2, 8, 8, 3, 3, 5, 5)),
    crops: [],
  },
} as unknown as SurveyData;

test("base64 becomes little-endian numbers", () => {
  expect([...decodeU16("AQD//w==")]).toEqual([1, 65535]);
});

test("fruits are decoded, a failed measurement stays NaN", () => {
  const [first, second] = decodeFruits(survey);
  expect(first).toMatchObject({ index: 0, id: 7, x: 0, y: 0.5, z: 1, views: 4, side: "east", tree: 1 });
  expect(first!.diameter).toBeCloseTo(0.08, 6);
  expect(second!.diameter).toBeNaN();
});

test("sightings are cameras for each fruit", () => {
  expect(decodeSightings(survey).map((seen) => seen.map(({ photo }) => photo))).toEqual([[6], [5, 7]]);
  expect(decodeSightings(survey)[0]![0]).toEqual({ fruit: 0, photo: 6, detection: 60, box: [1, 2, 8, 8], crop: "" });
});

test("a fruit without a diameter is drawn as large as the usual one", () => {
  expect(drawnRadii(decodeFruits(survey))[1]).toBeCloseTo(0.04, 6);
});

test("median ignores what was not measured", () => {
  expect(median([NaN, 1, 5, 3])).toBe(3);
  expect(median([NaN])).toBeNaN();
});

test("numbers sort as numbers, dashes last in either order", () => {
  const sorted = (order: "ascending" | "descending"): string[] => ["10.5", "–", "9", "-1"].sort((a, b) => compareCells(a, b, true, order));
  expect(sorted("ascending")).toEqual(["-1", "9", "10.5", "–"]);
  expect(sorted("descending")).toEqual(["10.5", "9", "-1", "–"]);
});

test("colours: ends of the ramp, one colour a side, grey where unknown", () => {
  expect(ramp(0)).toEqual([0.267, 0.005, 0.329]);
  expect(ramp(9)).toEqual([0.993, 0.906, 0.144]);
  const fruits = decodeFruits(survey);
  expect(colouring("side", fruits).categories!.map(([name]) => name)).toEqual(["not known", "east"]);
  expect(colouring("diameter", fruits).of(fruits[1]!)).toEqual([0.55, 0.55, 0.55]);
});

test("outlines are cut out of one array", () => {
  const columns: DetectionColumns = {
    ids: base64(Uint32Array.of(4, 9)), photos: base64(Uint32Array.of(0, 1)), fruits: base64(Uint32Array.of(7, 0)),
    scores: base64(Float32Array.of(0.5, 1)), starts: base64(Uint32Array.of(0, 1, 3)), points: base64(Float32Array.of(1, 2, 3, 4, 5, 6)),
  };
  expect(decodeDetections(columns).map(({ id, fruit, outline }) => [id, fruit, [...outline]])).toEqual([[4, 7, [1, 2]], [9, 0, [3, 4, 5, 6]]]);
});

test("a whole photo behind a window shows the window's part", () => {
  expect(placed([0, 0, 1000, 500], [100, 50, 50, 50])).toEqual({ left: -200, top: -100, width: 2000, height: 1000 });
  expect(placed([100, 50, 50, 50], [100, 50, 50, 50])).toEqual({ left: 0, top: 0, width: 100, height: 100 });
});

test("fruits within limits of score, height, place along the row and tree", () => {
  const fruits = decodeFruits(survey);
  const all = { score: 0, low: -9, high: 9, start: -9, end: 9, tree: 0 };
  expect(within(fruits, [1, 0], all)).toEqual([true, true]);
  expect(within(fruits, [1, 0], { ...all, score: 0.6 })).toEqual([true, false]);
  expect(within(fruits, [1, 0], { ...all, high: 2 })).toEqual([true, false]);
  expect(within(fruits, [1, 0], { ...all, end: -0.5 })).toEqual([false, true]);
  expect(within(fruits, [1, 0], { ...all, tree: 1 })).toEqual([true, false]);
});

test("the step of a score is the last one not above it", () => {
  const steps = [0, 0.5, 0.8].map((threshold) => ({ threshold }) as Rates);
  expect([0, 0.49, 0.5, 0.79, 1].map((score) => stepAt(steps, score))).toEqual([0, 0, 1, 1, 2]);
});

test("quantile of none is 0", () => {
  expect(quantile([], 0.5)).toBe(0);
  expect(quantile([3, NaN, 1, 2], 0)).toBe(1);
  expect(quantile([3, 1, 2], 1)).toBe(3);
});

test("marks along the row begin at 0 and are few", () => {
  expect(marks(-1, 1.2, 0.5)).toEqual([0, 0.5, 1, 1.5, 2]);
  expect(marks(0, 200, 1).length).toBeLessThanOrEqual(13);
  expect(marks(0, 0, 1)).toEqual([0]);
  expect(marks(0, 5000, 1).length).toBeLessThanOrEqual(14);
});

test("a shuffled order has every index once, and is the same again", () => {
  const order = shuffled(1000);
  expect([...order].sort((a, b) => a - b)).toEqual(Array.from({ length: 1000 }, (_, i) => i));
  expect(order.slice(0, 100).filter((i) => i < 500).length).toBeGreaterThan(30);
  expect(shuffled(1000)).toEqual(order);
});
