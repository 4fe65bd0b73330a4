/** Names as files and folders can have them on every system; the server has the same rules (`request.py`, `dropped.py`). */

const UNFIT = /[\x00-\x1f/\\:*?"<>|]+/g;

/** The folder that a survey of this name goes to. */
export function folderName(name: string): string {
  return name.trim().replace(UNFIT, "-").replace(/^[ .-]+|[ .-]+$/g, "").slice(0, 100);
}

const LONGEST = 150;

/** A file's name, with the folders that it lies in, as a copy can have it. Of a long one the end tells photos apart. */
export function copyName(path: string): string {
  const fit = path.split("/").map((part) => part.replace(UNFIT, "-").trim());
  return fit.map((part) => (part.length > LONGEST ? part.slice(10 - LONGEST).trim() : part)).join("/");
}
