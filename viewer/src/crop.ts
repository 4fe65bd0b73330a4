/** A crop of a photo around one detection, with its outline. */

import { element, pathOf, svg } from "./dom";
import type { Detection, Photo, Sighting } from "./payload";
import type { Picture } from "./source";

/** Where a picture of `box` has to lie, in percent of a window that shows `window` of the same photo. */
export function placed(box: Picture["box"], window: Picture["box"]): { left: number; top: number; width: number; height: number } {
  return {
    left: (100 * (box[0] - window[0])) / window[2],
    top: (100 * (box[1] - window[1])) / window[3],
    width: (100 * box[2]) / window[2],
    height: (100 * box[3]) / window[3],
  };
}

export function cropButton(sighting: Sighting, photo: Photo, picture: Picture | null, fruitId: number, onOpen: () => void): HTMLButtonElement {
  const made = element("button", "", "crop");
  made.type = "button";
  made.dataset.detection = String(sighting.detection);
  made.title = photo.name;
  made.setAttribute("aria-label", `Fruit ${fruitId} in photo ${photo.name}: show the photo`);
  made.addEventListener("click", onOpen);
  const window = element("span", "", "window");
  if (picture) {
    const image = element("img");
    image.loading = "lazy";
    image.alt = "";
    const { left, top, width, height } = placed(picture.box, sighting.box);
    Object.assign(image.style, { left: `${left}%`, top: `${top}%`, width: `${width}%`, height: `${height}%` });
    image.addEventListener("error", () => image.replaceWith(noPicture()));
    image.src = picture.url;
    window.append(image);
  } else {
    window.append(noPicture());
  }
  made.append(window, element("span", shortName(photo.name), "name"));
  return made;
}

function noPicture(): HTMLElement {
  return element("span", "no crop", "no-picture");
}

/** The last part of a photo's name, without its ending. */
export function shortName(name: string): string {
  return name.split("/").slice(-2).join("/").replace(/\.[^.]+$/, "");
}

/** Draw the outline of each crop's detection over it, once it is known. */
export function drawOutlines(box: HTMLElement, sightings: Sighting[], detections: Detection[]): void {
  const byId = new Map(detections.map((detection) => [detection.id, detection]));
  for (const sighting of sightings) {
    const detection = byId.get(sighting.detection);
    const window = box.querySelector(`[data-detection="${sighting.detection}"] .window`);
    if (!detection || !window || window.querySelector("svg")) continue;
    const drawing = svg("svg", { viewBox: sighting.box.join(" "), "aria-hidden": "true" });
    drawing.append(svg("path", { d: pathOf(detection.outline), class: "outline mine" }));
    window.append(drawing);
  }
}
