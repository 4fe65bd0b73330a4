import { describe, expect, it } from "vitest";
import { MOST, wanted } from "../src/framed";

describe("photos in frusta", () => {
  it("are of cameras that are large enough on the screen, the nearest first", () => {
    expect(wanted([20, NaN, 5, 90, 14])).toEqual([3, 0, 4]);
    expect(wanted([])).toEqual([]);
  });
  it("are never more than a few dozen", () => {
    const sizes = Float32Array.from({ length: 5000 }, (_, i) => 20 + i);
    expect(wanted(sizes)).toHaveLength(MOST);
    expect(wanted(sizes)[0]).toBe(4999);
  });
});
