/** Where data, photos, crops and outlines come from: the page itself, files beside it, or `pomona view`. */

import { decode, fetched, fromBase64, whyOf } from "./columns";
import type { DetectionColumns, PointPiece, SeenFruit, SurveyData } from "./contract";
import { say } from "./dom";
import { detectionsOf, sightingsOf, type Box, type Detection, type Fruit, type Photo, type Sighting } from "./payload";

/** A picture, and which part of its photo it shows. */
export interface Picture {
  url: string;
  box: Box;
}

/** What photos saw of one fruit. */
export interface Seen {
  sightings: Sighting[];
  detections: Detection[];
}

/** Resized copies that the server makes: the longer side in pixels. */
const SIDES = [1024, 2048, 4096, 8192];
const SMALL = 256;
/** So many answers of the server are kept. */
const KEPT = 300;

export class PhotoSource {
  private readonly known = new Map<string, Promise<unknown>>();
  private readonly byPhoto = new Map<number, Detection[]>();
  private readonly byFruit = new Map<number, Detection[]>();

  constructor(private readonly data: SurveyData) {
    for (const detection of data.detections ? detectionsOf(data.detections) : []) {
      listed(this.byPhoto, detection.photo).push(detection);
      listed(this.byFruit, detection.fruit).push(detection);
    }
  }

  /** Whether whole photos can be shown. */
  hasPhoto(photo: Photo): boolean {
    return photo.file !== "";
  }

  /** Whether photos have all their detections: a report has those alone whose crops are in it. */
  get hasAllDetections(): boolean {
    return this.data.source !== "report";
  }

  /** What to tell where a photo is not there. */
  get note(): string {
    return this.data.photosNote;
  }

  /** Tell why where a photo was there when the page was made, and cannot be loaded into an image any more. */
  watch(image: HTMLImageElement, tell: (why: string) => void): void {
    image.addEventListener("error", async () => {
      const url = image.getAttribute("src");
      const why = url ? await this.whyNot(url) : "";
      if (!url || image.getAttribute("src") !== url) return;
      tell(why);
      say(why);
    });
  }

  private async whyNot(url: string): Promise<string> {
    if (this.data.source !== "server") return "This photo is not beside the page any more, or is damaged.";
    try {
      await fetch(url);
      return "This photo is not where it was, or was changed: put it back, or open the survey again.";
    } catch (error) {
      return `This photo could not be loaded: ${whyOf(error)}`;
    }
  }

  /** The address of a photo whose longer side has at least `side` pixels, where there is one so large. */
  photo(photo: Photo, side: number): string {
    if (this.data.source !== "server") return photo.file;
    const longer = Math.max(photo.width, photo.height);
    return this.sized(photo, SIDES.find((size) => size >= Math.min(side, longer)) ?? SIDES[SIDES.length - 1]!);
  }

  /** A small copy without the lens's distortion; null where no server makes one. */
  small(photo: Photo): string | null {
    return this.data.source === "server" && this.hasPhoto(photo) ? this.sized(photo, SMALL).replace(/^photos\//, "straight/") : null;
  }

  /** The photo without the lens's distortion, where the server can make that. */
  straight(photo: Photo, side: number): string {
    return this.photo(photo, side).replace(/^photos\/(?=\d+\/)/, "straight/");
  }

  private sized(photo: Photo, side: number): string {
    return `${photo.file}/${side}.jpg?${this.data.photosVersion}`;
  }

  /** A picture of what the photo saw there; null where there is none. */
  crop(sighting: Sighting, photo: Photo): Picture | null {
    if (sighting.crop.length) return { url: `data:image/jpeg;base64,${btoa(String.fromCharCode(...sighting.crop))}`, box: sighting.box };
    if (!this.hasPhoto(photo)) return null;
    if (this.data.source === "server") return { url: `crops/${sighting.photo}/${sighting.detection}.jpg`, box: sighting.box };
    return { url: photo.file, box: [0, 0, photo.width, photo.height] };
  }

  /** Which photos saw a fruit, and its detections in them. */
  async ofFruit(fruit: Fruit): Promise<Seen> {
    const { sightings } = this.data;
    if (sightings) return { sightings: sightingsOf(sightings, fruit.index), detections: this.byFruit.get(fruit.id) ?? [] };
    const seen = await this.ask<SeenFruit>(`data/fruits/${fruit.id}.bin`);
    return { sightings: sightingsOf(seen.sightings, 0), detections: detectionsOf(seen.detections) };
  }

  /** All detections of a photo, as far as they are known. */
  async ofPhoto(photo: number): Promise<Detection[]> {
    if (this.data.source !== "server") return this.byPhoto.get(photo) ?? [];
    return detectionsOf(await this.ask<DetectionColumns>(`data/photos/${photo}.bin`));
  }

  /** More points of a cloud, where a server has them. */
  async points(cloud: "scene" | "fruit", piece: number): Promise<Uint16Array> {
    return (await fetched<PointPiece>(`data/points/${cloud}/${piece}.bin`)).points;
  }

  private ask<T>(url: string): Promise<T> {
    const found = this.known.get(url) ?? fetched<T>(url);
    found.catch(() => this.known.delete(url));
    // What was asked for last comes last, and what was asked for first goes first.
    this.known.delete(url);
    this.known.set(url, found);
    for (const oldest of this.known.keys()) {
      if (this.known.size <= KEPT) break;
      this.known.delete(oldest);
    }
    return found as Promise<T>;
  }
}

function listed<K, V>(lists: Map<K, V[]>, key: K): V[] {
  const list = lists.get(key) ?? [];
  lists.set(key, list);
  return list;
}

/** The survey's data: in the page, or from the server that gave the page. */
export async function loadSurvey(script: HTMLElement): Promise<SurveyData> {
  const url = script.dataset.url;
  return url ? fetched<SurveyData>(url) : decode<SurveyData>(fromBase64(script.textContent ?? ""));
}
