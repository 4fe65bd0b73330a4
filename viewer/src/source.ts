/** Where photos, crops and outlines come from: the page itself, files beside it, or `pomona view`. */

import type { DetectionColumns, SurveyData } from "./contract";
import { decodeDetections, type Box, type Detection, type Photo, type Sighting } from "./payload";

/** A picture, and which part of its photo it shows. */
export interface Picture {
  url: string;
  box: Box;
}

/** Resized copies that the server makes: the longer side in pixels. */
const SIDES = [1024, 2048, 4096, 8192];

export class PhotoSource {
  private readonly known = new Map<string, Promise<Detection[]>>();
  private readonly inPage: Detection[];

  constructor(private readonly data: SurveyData, private readonly fruitIds: number[]) {
    this.inPage = decodeDetections(data.detections);
  }

  /** Whether whole photos can be shown. */
  hasPhoto(photo: Photo): boolean {
    return photo.file !== "";
  }

  /** What to tell where a photo is not there. */
  get note(): string {
    return this.data.photosNote;
  }

  /** The address of a photo whose longer side has at least `side` pixels, where there is one so large. */
  photo(photo: Photo, side: number): string {
    if (this.data.source !== "server") return photo.file;
    const longer = Math.max(photo.width, photo.height);
    return `${photo.file}/${SIDES.find((size) => size >= Math.min(side, longer)) ?? SIDES[SIDES.length - 1]}.jpg`;
  }

  /** The photo without the lens's distortion, where the server can make that. */
  straight(photo: Photo, side: number): string {
    return this.photo(photo, side).replace(/^photos\/(?=\d+\/)/, "straight/");
  }

  /** A picture of what the photo saw there; null where there is none. */
  crop(sighting: Sighting, photo: Photo): Picture | null {
    if (sighting.crop) return { url: `data:image/jpeg;base64,${sighting.crop}`, box: sighting.box };
    if (!this.hasPhoto(photo)) return null;
    if (this.data.source === "server") return { url: `crops/${sighting.detection}.jpg`, box: sighting.box };
    return { url: photo.file, box: [0, 0, photo.width, photo.height] };
  }

  /** All detections of a photo, as far as they are known. */
  ofPhoto(photo: number): Promise<Detection[]> {
    return this.get(`data/photos/${photo}.json`, (detection) => detection.photo === photo);
  }

  /** The detections that became this fruit. */
  ofFruit(fruit: number): Promise<Detection[]> {
    const id = this.fruitIds[fruit]!;
    return this.get(`data/fruits/${id}.json`, (detection) => detection.fruit === id);
  }

  private get(url: string, wanted: (detection: Detection) => boolean): Promise<Detection[]> {
    if (this.data.source !== "server") return Promise.resolve(this.inPage.filter(wanted));
    let found = this.known.get(url);
    if (!found) {
      found = fetch(url).then(async (answer) => (answer.ok ? decodeDetections((await answer.json()) as DetectionColumns) : []));
      found.catch(() => this.known.delete(url));
      this.known.set(url, found);
    }
    return found;
  }
}

/** The survey's data: in the page, or from the server that gave the page. */
export async function loadSurvey(script: HTMLElement): Promise<SurveyData> {
  const url = script.dataset.url;
  if (!url) return JSON.parse(script.textContent ?? "{}") as SurveyData;
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url}: ${answer.status}`);
  return (await answer.json()) as SurveyData;
}
