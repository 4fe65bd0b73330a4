import { expect, test } from "vitest";
import { colouring, drawnRadii, ramp } from "../src/colours";
import { decodeFruits, decodeSightings, decodeU16, median, type Payload } from "../src/payload";
import { compareCells } from "../src/table";

const base64 = (values: Float32Array | Uint32Array): string => btoa(String.fromCharCode(...new Uint8Array(values.buffer)));

const payload = {
  fruits: {
    ids: [7, 3],
    centers: base64(Float32Array.of(0, 0.5, 1, -1, 2, 3)),
    diameters: base64(Float32Array.of(0.08, NaN)),
    scores: base64(Float32Array.of(1, 0.5)),
    views: base64(Uint32Array.of(4, 2)),
    sides: ["east", ""],
    trees: [1, 0],
  },
  sightings: { fruits: base64(Uint32Array.of(1, 0, 1)), cameras: base64(Uint32Array.of(5, 6, 7)) },
} as unknown as Payload;

test("base64 becomes little-endian numbers", () => {
  expect([...decodeU16("AQD//w==")]).toEqual([1, 65535]);
});

test("fruits are decoded, a failed measurement stays NaN", () => {
  const [first, second] = decodeFruits(payload);
  expect(first).toMatchObject({ index: 0, id: 7, x: 0, y: 0.5, z: 1, views: 4, side: "east", tree: 1 });
  expect(first!.diameter).toBeCloseTo(0.08, 6);
  expect(second!.diameter).toBeNaN();
});

test("sightings are cameras for each fruit", () => {
  expect(decodeSightings(payload)).toEqual([[6], [5, 7]]);
});

test("a fruit without a diameter is drawn as large as the usual one", () => {
  expect(drawnRadii(decodeFruits(payload))[1]).toBeCloseTo(0.04, 6);
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
  const fruits = decodeFruits(payload);
  expect(colouring("side", fruits).categories!.map(([name]) => name)).toEqual(["not known", "east"]);
  expect(colouring("diameter", fruits).of(fruits[1]!)).toEqual([0.55, 0.55, 0.55]);
});
