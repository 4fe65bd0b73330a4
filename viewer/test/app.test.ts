import { describe, expect, it } from "vitest";
import { isFit, withFitNames, withoutCommon, type Dropped } from "../src/app/dropping";
import { folderName } from "../src/app/names";
import { numberIn } from "../src/app/numbers";
import { LANGUAGES } from "../src/app/texts";
import { fileName } from "../src/app/server";

const named = (...names: string[]): Dropped[] => names.map((name) => ({ name, file: new File([], name) }));

describe("dropped files", () => {
  it("are photos and videos, and nothing hidden", () => {
    for (const name of ["IMG_1.JPG", "east/a.heic", "walk.mp4"]) expect(isFit(name)).toBe(true);
    for (const name of ["notes.txt", ".a.jpg", ".trash/a.jpg", "survey.json"]) expect(isFit(name)).toBe(false);
  });
  it("lose the folder that all lie in, and keep the sides of the row", () => {
    const kept = (...names: string[]) => withoutCommon(named(...names)).map(({ name }) => name);
    expect(kept("row/a.jpg", "row/b.jpg")).toEqual(["a.jpg", "b.jpg"]);
    expect(kept("row/east/a.jpg", "row/west/a.jpg")).toEqual(["east/a.jpg", "west/a.jpg"]);
    expect(kept("a.jpg", "row/b.jpg")).toEqual(["a.jpg", "row/b.jpg"]);
  });
});

describe("names that files cannot have everywhere", () => {
  it("are told as the survey's folder has them", () => {
    expect(["Row 7/8", " Block A: west? ", "..hidden..", "Zeile 1"].map(folderName)).toEqual(["Row 7-8", "Block A- west", "hidden", "Zeile 1"]);
  });
  it("are others in copies, where no two are the same", () => {
    const fit = (...names: string[]) => withFitNames(named(...names)).map(({ name }) => name);
    expect(fit("a.jpg", "12:30:05.jpg", "east?/b.jpg")).toEqual(["a.jpg", "12-30-05.jpg", "east-/b.jpg"]);
    expect(fit(`${"x".repeat(200)}7.jpg`)).toEqual([`${"x".repeat(135)}7.jpg`]);
    expect(fit("a?.jpg", "a*.jpg", "a-.jpg", " a-.jpg")).toEqual(["a--.jpg", "a---.jpg", "a-.jpg", "a----.jpg"]);
  });
});

describe("numbers in fields", () => {
  it("may have the field's unit behind them, and are no others than were typed", () => {
    expect(["75", " 75 mm", "75mm", "7,5", "7.5 MM", ".5"].map((text) => numberIn(text, "mm"))).toEqual([75, 75, 75, 7.5, 7.5, 0.5]);
    expect(["", "  "].map((text) => numberIn(text, "mm"))).toEqual([null, null]);
    expect(["seventy", "7 cm", "1.000,5", "-3", "mm", "0x10", "1e3", "7 5"].map((text) => numberIn(text, "mm"))).toEqual(Array(8).fill(NaN));
    expect([numberIn("2.5 m", "m"), numberIn("2.5 mm", "m"), numberIn("3", "")]).toEqual([2.5, NaN, 3]);
  });
});

describe("texts", () => {
  it("say a thing in each language", () => {
    const empty = Object.entries(LANGUAGES).flatMap(([code, texts]) =>
      Object.entries(texts).filter(([name, text]) => text === "" && name !== "english").map(([name]) => `${code}.${name}`),
    );
    expect(empty).toEqual([]);
    expect(Object.keys(LANGUAGES.de!.fruitNames)).toEqual(Object.keys(LANGUAGES.en!.fruitNames));
    expect(Object.keys(LANGUAGES.de!.stages)).toEqual(Object.keys(LANGUAGES.en!.stages));
  });
});

describe("the name of a download", () => {
  it("may have spaces and letters of any script", () => {
    expect(fileName("attachment; filename=\"row-fruits.gpkg\"")).toBe("row-fruits.gpkg");
    expect(fileName("attachment; filename*=utf-8''Row%201-%C3%84pfel.gpkg")).toBe("Row 1-Äpfel.gpkg");
    expect(fileName("")).toBe("pomona");
  });
});
