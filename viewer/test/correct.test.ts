import { expect, test } from "vitest";
import { advice, boxAround, withMark } from "../src/correct-marks";

const mark = (photo: number, x = 0): { photo: number; x: number; y: number } => ({ photo, x, y: 0 });

test("an added fruit has one mark a photo, the last one", () => {
  const two = withMark("add", withMark("add", [], mark(1)), mark(2));
  expect(two).toEqual([mark(1), mark(2)]);
  expect(withMark("add", two, mark(1, 9))).toEqual([mark(2), mark(1, 9)]);
});

test("two fruits that were taken for one are marked in one photo", () => {
  const two = withMark("split", withMark("split", [], mark(1, 5)), mark(1, 8));
  expect(two).toEqual([mark(1, 5), mark(1, 8)]);
  expect(withMark("split", two, mark(1, 9))).toEqual([mark(1, 8), mark(1, 9)]);
  expect(withMark("split", two, mark(3, 1))).toEqual([mark(3, 1)]);
});

test("what to do next is said at each step", () => {
  const add = (marks: number, size = 0): Parameters<typeof advice>[0] => ({
    kind: "add", fruits: [], marks: Array.from({ length: marks }, (_, i) => mark(i)), size: Array.from({ length: size }, () => mark(0)),
  });
  expect([0, 1, 2, 3].map((marks) => advice(add(marks), false).split(" ")[0])).toEqual(["Click", "Now", "Add", "Add"]);
  expect([0, 1].map((size) => advice(add(2, size), true))).toEqual(["Click one edge of the fruit.", "Now click its opposite edge."]);
  expect(advice({ kind: "split", fruits: [12], marks: [], size: [] }, false)).toContain("taken for fruit 12");
});

test("a line is shown with what is around it", () => {
  const [x, y, width, height] = boxAround([100, 100, 1100, 200]);
  expect([x + width / 2, y + height / 2]).toEqual([600, 150]);
  expect(width).toBeCloseTo(1600);
  expect(height).toBe(width);
  expect(boxAround([5, 5, 6, 6])[2]).toBe(400);
});
