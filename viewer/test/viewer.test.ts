import * as three from "three";
import { expect, test } from "vitest";
import { colouring, drawnRadii, ramp } from "../src/colours";
import { decode, fromBase64 } from "../src/columns";
import { placed } from "../src/crop";
import type { DetectionColumns, Rates, Sightings, SurveyData } from "../src/contract";
import { within } from "../src/filter";
import { detectionsOf, fruitsOf, median, quantile, sightingsOf, type Fruit, type Photo } from "../src/payload";
import { PointCloud, pointSize } from "../src/points";
import { byChange, byGrowth } from "../src/earlier";
import { localised, localisedDay, localisedText, short } from "../src/locale";
import { throughLens } from "../src/navigation";
import { classesOf, cropClasses, edgesIn, millimetres } from "../src/packing";
import { detectedText, keptText } from "../src/photo";
import { marks, readable } from "../src/row";
import { PhotoSource } from "../src/source";
import { columnsOf, compared, rowsInSight } from "../src/table";
import { stepAt } from "../src/truth";
import { fruitAt } from "../src/watch";

const survey = {
  metric: true,
  unit: "m",
  origin: [10, 20, 30],
  fruits: {
    ids: [7, 3],
    centers: Float32Array.of(0, 0.5, 1, -1, 2, 3),
    diameters: Float32Array.of(0.08, NaN),
    diameterSds: Float32Array.of(0.002, NaN),
    visibilities: Float32Array.of(NaN, NaN),
    weights: Float32Array.of(NaN, NaN),
    scores: Float32Array.of(1, 0.5),
    views: Uint32Array.of(4, 2),
    sides: ["east", ""],
    trees: [1, 0],
    reasons: ["", "seen once"],
  },
} as unknown as SurveyData;

const sightings: Sightings = {
  starts: Uint32Array.of(0, 1, 3),
  photos: Uint32Array.of(6, 5, 7),
  detections: Uint32Array.of(60, 50, 70),
  boxes: Float32Array.of(1, 2, 8, 8, 0, 0, 9, 9, 3, 3, 5, 5),
  cropStarts: Uint32Array.of(0, 0, 2, 2),
  crops: Uint8Array.of(255, 216),
};

/** What Python's `as_bytes` makes of a name and two columns. */
function travelled(): ArrayBuffer {
  const json = JSON.stringify({ name: "Öl", ids: { column: "u2", at: 0, count: 3 }, empty: [], sizes: { column: "f4", at: 8, count: 2 } });
  const text = new TextEncoder().encode(json);
  const padded = text.length + ((8 - ((4 + text.length) % 8)) % 8);
  const bytes = new Uint8Array(4 + padded + 16).fill(32);
  new DataView(bytes.buffer).setUint32(0, padded, true);
  bytes.set(text, 4);
  new Uint16Array(bytes.buffer, 4 + padded, 3).set([1, 2, 65535]);
  new Float32Array(bytes.buffer, 4 + padded + 8, 2).set([0.5, NaN]);
  return bytes.buffer;
}

test("columns are numbers in the bytes behind the JSON", () => {
  const { name, ids, empty, sizes } = decode<{ name: string; ids: Uint16Array; empty: string[]; sizes: Float32Array }>(travelled());
  expect([name, [...ids], empty, [...sizes]]).toEqual(["Öl", [1, 2, 65535], [], [0.5, NaN]]);
  expect(ids.buffer).toBe(sizes.buffer);
});

test("base64 becomes bytes", () => {
  expect([...new Uint16Array(fromBase64("AQD//w=="))]).toEqual([1, 65535]);
});

test("fruits are objects, a failed measurement stays NaN", () => {
  const [first, second] = fruitsOf(survey);
  expect(first).toMatchObject({ index: 0, id: 7, x: 0, y: 0.5, z: 1, views: 4, side: "east", tree: 1 });
  expect(first!.diameter).toBeCloseTo(0.08, 6);
  expect(second!.diameter).toBeNaN();
});

test("sightings of a fruit lie between two starts", () => {
  expect([0, 1, 2].map((fruit) => sightingsOf(sightings, fruit).map(({ photo }) => photo))).toEqual([[6], [5, 7], []]);
  expect(sightingsOf(sightings, 0)[0]).toEqual({ photo: 6, detection: 60, box: [1, 2, 8, 8], crop: new Uint8Array(0) });
  expect(sightingsOf(sightings, 1).map(({ crop }) => [...crop])).toEqual([[255, 216], []]);
});

test("a fruit without a diameter is drawn as large as the usual one", () => {
  expect(drawnRadii(fruitsOf(survey))[1]).toBeCloseTo(0.04, 6);
});

test("median ignores what was not measured", () => {
  expect(median([NaN, 1, 5, 3])).toBe(3);
  expect(median([NaN])).toBeNaN();
});

test("numbers sort as numbers, what was not measured last in either order", () => {
  const sorted = (order: "ascending" | "descending"): number[] => [10.5, NaN, 9, -1].sort((a, b) => compared(a, b, order));
  expect(sorted("ascending")).toEqual([-1, 9, 10.5, NaN]);
  expect(sorted("descending")).toEqual([10.5, 9, -1, NaN]);
  expect(["tree 10", "tree 9"].sort((a, b) => compared(a, b, "ascending"))).toEqual(["tree 9", "tree 10"]);
});

test("the table has the columns that say something, in the world's metres", () => {
  const fruits = fruitsOf(survey);
  const columns = columnsOf(survey, fruits);
  expect(columns.map(({ label }) => label)).toEqual(["id", "x", "y", "z", "diameter", "±", "score", "photos", "tree", "side", "not measured because"]);
  expect(columns.slice(0, 4).map(({ value }) => value(fruits[1]!))).toEqual([3, 9, 22, 33]);
  expect(columns[4]!.value(fruits[0]!)).toBeCloseTo(80, 4);
  expect(columns[8]!.value(fruits[1]!)).toBeNaN();
});

test("of many rows only those in sight are in the page", () => {
  expect(rowsInSight(0, 500, 29, 150)).toEqual([0, 150]);
  expect(rowsInSight(0, 500, 29, 20_000)).toEqual([0, 38]);
  const [first, end] = rowsInSight(290_000, 500, 29, 20_000);
  expect([first <= 10_000, end >= 10_018, end - first < 100]).toEqual([true, true, true]);
  expect(rowsInSight(1e9, 500, 29, 20_000)).toEqual([19_980, 20_000]);
});

test("colours: ends of the ramp, one colour a side, grey where unknown", () => {
  expect(ramp(0)).toEqual([0.267, 0.005, 0.329]);
  expect(ramp(9)).toEqual([0.993, 0.906, 0.144]);
  const fruits = fruitsOf(survey);
  expect(colouring("side", fruits).categories!.map(([name]) => name)).toEqual(["not known", "east"]);
  expect(colouring("diameter", fruits).of(fruits[1]!)).toEqual([0.55, 0.55, 0.55]);
});

test("outlines are cut out of one array", () => {
  const columns: DetectionColumns = {
    ids: Uint32Array.of(4, 9), photos: Uint32Array.of(0, 1), fruits: Uint32Array.of(7, 0),
    scores: Float32Array.of(0.5, 1), starts: Uint32Array.of(0, 1, 3), points: Float32Array.of(1, 2, 3, 4, 5, 6),
  };
  expect(detectionsOf(columns).map(({ id, fruit, outline }) => [id, fruit, [...outline]])).toEqual([[4, 7, [1, 2]], [9, 0, [3, 4, 5, 6]]]);
});

test("a whole photo behind a window shows the window's part", () => {
  expect(placed([0, 0, 1000, 500], [100, 50, 50, 50])).toEqual({ left: -200, top: -100, width: 2000, height: 1000 });
  expect(placed([100, 50, 50, 50], [100, 50, 50, 50])).toEqual({ left: 0, top: 0, width: 100, height: 100 });
});

test("fruits within limits of score, height, place along the row and tree", () => {
  const fruits = fruitsOf(survey);
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

test("labels that would lie over others are left out, the first ones stay", () => {
  const at = (x: number, y = 0) => ({ x, y, width: 2, height: 1 });
  expect(readable([at(0), at(1.9), at(2), at(3), at(4), at(3, 1)])).toEqual([true, false, true, false, true, true]);
  expect(readable([])).toEqual([]);
});

test("what was detected in a photo is said in the singular, too", () => {
  expect(detectedText(0, 0)).toBe("");
  expect(detectedText(1, 1)).toBe("1 detection, which became a fruit");
  expect(detectedText(1, 0)).toBe("1 detection, which became no fruit");
  expect(detectedText(5, 1)).toBe("5 detections, 1 of them became a fruit");
  expect(detectedText(5, 3)).toBe("5 detections, 3 of them became fruits");
  expect([0, 1, 18].map(keptText)).toEqual(["", "1 outline of this photo in this file", "18 outlines of this photo in this file"]);
});

test("fractions in hints are written as the reader's language does, names are not", () => {
  expect(localisedText("-3.5 to 3.75 mm: 1 fruit", "de")).toBe("-3,5 to 3,75 mm: 1 fruit");
  expect(localisedText("row.2/IMG_1.5.JPG: 2.5", "de")).toBe("row.2/IMG_1.5.JPG: 2,5");
});

test("short numbers have no more places than they need", () => {
  expect([short(0.5), short(12), short(1000.25), short(0.07473, 3)]).toEqual(["0.5", "12", "1000.25", "0.0747"]);
});

test("points are as large as they are far apart", () => {
  const view = { row: [0, 200] as [number, number], low: 0, high: 3, radius: 100 };
  expect(pointSize(5_000_000, view)).toBeCloseTo(0.05, 2);
  expect(pointSize(600, view)).toBeGreaterThan(1);
  expect(pointSize(1, { ...view, radius: 2 })).toBe(0.05);
});

test("more points are asked for once, piece by piece, and can be met", async () => {
  const cloud = { count: 5, min: [0, 0, 0] as [number, number, number], size: [1, 1, 1] as [number, number, number], points: Uint16Array.of(0, 0, 0, 0, 0, 0, 65535, 0) };
  const view = { row: [0, 1], low: 0, high: 1, radius: 1 } as unknown as SurveyData["view"];
  const asked: number[] = [];
  const drawn: unknown[] = [];
  const more = async (piece: number): Promise<Uint16Array> => (asked.push(piece), Uint16Array.of(65535, 65535, 32768, 0));
  const points = new PointCloud(cloud, view, more, (piece) => drawn.push(piece));
  await Promise.all([points.load(), points.load()]);
  expect([asked, drawn.length, points.later.length]).toEqual([[1, 2], 2, 2]);
  const at = new three.Vector3(1, 1, 0.5);
  const ray = new three.Ray(new three.Vector3(0.5, -3, 0.5), at.clone().sub(new three.Vector3(0.5, -3, 0.5)).normalize());
  expect(points.hit(ray, 0.01)!.distanceTo(at)).toBeLessThan(1e-4);
  points.clip([new three.Plane(new three.Vector3(0, 0, 1), -0.6)]);
  expect(points.hit(ray, 0.01)).toBeNull();
});

test("fruits fall into packing classes with their weights, and classes can be typed", () => {
  const classes = classesOf([59.9, 60, 64.9, 65, 91, NaN], [100, 110, 120, NaN, 300, 50], [60, 65, 90]);
  expect(classes.map(({ fruits }) => fruits)).toEqual([1, 2, 1, 1]);
  expect(classes.map(({ weight }) => weight)).toEqual([100, 230, 0, 300]);
  expect(classes[0]!.from).toBe(-Infinity);
  expect(edgesIn("70, 60; 65 72,5 60 x")).toEqual([60, 65, 70, 72.5]);
  expect(edgesIn("none")).toEqual([]);
  // As the command line takes them, and as one types who writes fractions with a comma.
  expect(edgesIn("60,65,70")).toEqual([60, 65, 70]);
  expect(edgesIn("60.5,65.5")).toEqual([60.5, 65.5]);
  expect(edgesIn("62,5,67,5,72,5")).toEqual([62.5, 67.5, 72.5]);
  expect(edgesIn("62,5 67,5")).toEqual([62.5, 67.5]);
});

test("a fruit that is as wide as an edge is in the class that begins there", () => {
  const sizes = Array.from(Float32Array.of(0.06, 0.0649, 0.065, 0.0651, 0.07, NaN), millimetres);
  expect(classesOf(sizes, sizes.map(() => NaN), [60, 65, 70]).map(({ fruits }) => fruits)).toEqual([0, 2, 2, 1]);
});

test("the first and the last fruit of a long row are shown where nothing is left out", () => {
  const ends = Array.from({ length: 60 }, (_, i) => 60 + 1.2345678 * i);
  const hidden = ends.filter((end) => {
    const fruits = [-end, end].map((x) => ({ x: Math.fround(0.6 * x), y: Math.fround(0.8 * x), z: 0, score: 1, tree: 0 }) as Fruit);
    return within(fruits, [0.6, 0.8, 0], { score: 0, low: 0, high: 0, start: -end, end, tree: 0 }).includes(false);
  });
  expect(hidden).toEqual([]);
  const near = { x: 100, y: 0, z: 0, score: 1, tree: 0 } as Fruit;
  expect(within([near], [1, 0, 0], { score: 0, low: 0, high: 0, start: 0, end: 99.999, tree: 0 })).toEqual([false]);
});

test("what a photo shows at a place is found whatever its number", () => {
  const square = (x: number, y: number): Float32Array => Float32Array.of(x - 10, y - 10, x + 10, y - 10, x + 10, y + 10, x - 10, y + 10);
  const detections = [[100, 100, 7], [112, 100, 3], [300, 50, 0]].map(([x, y, fruit], i) => ({ id: i + 1, photo: 0, fruit: fruit!, score: 1, outline: square(x!, y!) }));
  expect(fruitAt(detections, { x: 111, y: 101, half: 20 })).toBe(3);
  expect(fruitAt(detections, { x: 101, y: 99, half: 20 })).toBe(7);
  expect(fruitAt(detections, { x: 300, y: 50, half: 20 })).toBe(0); // became no fruit
  expect(fruitAt(detections, { x: 100, y: 115, half: 20 })).toBe(0); // nothing is there any more
});

test("through a camera, photo and scene lie over each other, of whatever focal lengths", () => {
  for (const lens of [[1000, 1000, 700, 480], [1400, 1050, 730, 470], [900, 1200, 640, 540]]) {
    const [fx, fy, cx, cy] = lens as [number, number, number, number];
    const { place, fov } = throughLens({ width: 1440, height: 1080, lens: Float32Array.from(lens) }, 800, 600);
    const camera = new three.PerspectiveCamera(fov, 800 / 600, 0.1, 100);
    camera.updateMatrixWorld();
    for (const [x, y] of [[0.3, -0.2], [-0.4, 0.35]] as const) {
      // Three's cameras look along −z, with y up.
      const seen = new three.Vector3(2 * x, -2 * y, -2).project(camera);
      const inPhoto = [(fx * x + cx) / 1440, (fy * y + cy) / 1080] as const;
      expect(place.left + inPhoto[0] * place.width).toBeCloseTo(400 * (1 + seen.x), 3);
      expect(place.top + inPhoto[1] * place.height).toBeCloseTo(300 * (1 - seen.y), 3);
    }
    expect(Math.max(place.width / 800, place.height / 600)).toBeCloseTo(1, 6);
  }
});

test("a server's photos are asked for as those of this survey alone", () => {
  const photo = { file: "photos/4", width: 3000, height: 4000 } as Photo;
  const source = new PhotoSource({ ...survey, source: "server", photosVersion: "5af3", detections: null } as SurveyData);
  expect(source.photo(photo, 1500)).toBe("photos/4/2048.jpg?5af3");
  expect(source.straight(photo, 9000)).toBe("straight/4/4096.jpg?5af3");
  expect(source.small(photo)).toBe("straight/4/256.jpg?5af3");
  const folder = new PhotoSource({ ...survey, source: "folder", photosVersion: "", detections: null } as SurveyData);
  expect(folder.straight({ ...photo, file: "photos/00004.jpg" }, 9000)).toBe("photos/00004.jpg");
});

test("the whole crop falls into packing classes by how many of it are smaller", () => {
  const crop = { edges: [50, 60, 70], fruits: [0, 40, 100], kg: [0, 4, 16] };
  expect(cropClasses(crop, [45, 55, 60, 65])).toEqual([0, 20, 20, 30, 30].map((fruits, i) => ({ fruits, kg: [0, 2, 2, 6, 6][i] })));
  expect(cropClasses(crop, [80]).map(({ fruits }) => fruits)).toEqual([100, 0]);
  expect(cropClasses(crop, []).map(({ kg }) => kg)).toEqual([16]);
});

test("numbers and days are written as the reader writes them", () => {
  expect(localised(12345.67, 1, "de-DE")).toBe("12.345,7");
  expect(localised(12345.67, 1, "en-GB")).toBe("12,345.7");
  expect(localisedDay("2026-08-02", "de-DE")).toBe("02.08.2026");
  expect(localisedDay("2026-08-02", "en-GB")).toBe("2 Aug 2026");
});

test("fruits of an earlier survey say which are new, and how much the others grew", () => {
  const earlier = { centers: Float32Array.of(0, 0, 0), diameters: Float32Array.of(0.06), later: [1], inView: Uint8Array.of(1), growth: Float32Array.of(NaN, 0.012) };
  const fruits = fruitsOf(survey);
  const [same, fresh] = [byChange(earlier).of(fruits[1]!), byChange(earlier).of(fruits[0]!)];
  expect(same).not.toEqual(fresh);
  expect(byGrowth(earlier).range![0]).toBeCloseTo(0.012, 6);
});
