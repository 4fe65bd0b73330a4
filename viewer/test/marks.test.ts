import { describe, expect, it } from "vitest";
import { between, changed, inside, outlineAt, undone, zoomed, type Marking, type Point } from "../src/app/marks";

const SIZE: Point = [1000, 500];

describe("marks between two points", () => {
  it("are boxes with these corners, in any order, inside the photo", () => {
    expect(between("box", [30, 40], [10, 20], SIZE)).toEqual({ box: [10, 20, 30, 40], circle: null });
    expect(between("box", [-10, 450], [30, 600], SIZE)).toEqual({ box: [0, 450, 30, 500], circle: null });
  });
  it("are circles with these points opposite on the rim", () => {
    expect(between("circle", [100, 100], [140, 130], SIZE)).toEqual({ box: [95, 90, 145, 140], circle: [120, 115, 25] });
    expect(between("circle", [0, 100], [40, 100], SIZE)!.box).toEqual([0, 80, 40, 120]);
    expect(between("circle", [-20, 100], [20, 100], SIZE)).toEqual({ box: [0, 80, 20, 120], circle: [0, 100, 20] });
  });
  it("are none where the points are one", () => {
    for (const shape of ["box", "circle"] as const) expect(between(shape, [5, 5], [6, 5], SIZE)).toBeNull();
  });
});

describe("a click", () => {
  const marks = [between("box", [100, 100], [200, 200], SIZE)!, between("circle", [150, 100], [150, 160], SIZE)!];
  it("finds the mark whose line is near, not what is inside", () => {
    expect(outlineAt(marks, [103, 150], 6)).toBe(0);
    expect(outlineAt(marks, [206, 203], 7)).toBe(0);
    expect(outlineAt(marks, [150, 161], 6)).toBe(1);
    expect(outlineAt(marks, [150, 130], 6)).toBe(-1);
    expect(outlineAt(marks, [150, 180], 6)).toBe(-1);
  });
});

describe("what is taken back", () => {
  it("is the last step, whatever it was", () => {
    const mark = between("box", [1, 1], [9, 9], SIZE)!;
    const begun: Marking = { marks: [], complete: false, before: [] };
    const drawn = changed(begun, [mark]);
    const all = changed(drawn, drawn.marks, true);
    expect(undone(all)).toEqual(drawn);
    expect(undone(undone(all))).toEqual(begun);
    expect(undone(begun)).toBe(begun);
  });
});

describe("a photo looked at", () => {
  it("keeps the point under the pointer where it is", () => {
    const [x, y, w, h] = zoomed([0, 0, 1000, 500], 2, [250, 125], SIZE);
    expect([x, y, w, h]).toEqual([125, 62.5, 500, 250]);
    expect((250 - x) / w).toBeCloseTo(0.25);
  });
  it("is never more than the photo, never less than a thirtieth, and never out of sight", () => {
    expect(zoomed([0, 0, 1000, 500], 0.5, [500, 250], SIZE)).toEqual([0, 0, 1000, 500]);
    expect(zoomed([0, 0, 1000, 500], 1000, [500, 250], SIZE)[2]).toBeCloseTo(1000 / 30);
    expect(inside([5000, -5000, 100, 50], SIZE)).toEqual([950, -25, 100, 50]);
  });
});
