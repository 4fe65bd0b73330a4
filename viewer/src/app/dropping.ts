/** Files that are dropped on the page, with the folders they lie in. */

import { copyName } from "./names";
import { send, tell } from "./server";

export interface Dropped {
  name: string;
  file: File;
}

/** What the server takes for photos and videos; it checks again. */
const FIT = /\.(jpe?g|jpe|png|tiff?|hei[cf]|webp|bmp|mp4|mov|m4v|avi|mkv|webm|mts|m2ts|mpg|mpeg|3gp)$/i;

export function isFit(name: string): boolean {
  return FIT.test(name) && !name.split("/").some((part) => part.startsWith("."));
}

async function inside(entry: FileSystemEntry, above: string): Promise<Dropped[]> {
  const name = above + entry.name;
  if (entry.isFile) return [{ name, file: await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject)) }];
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const found: Dropped[] = [];
  for (;;) {
    // A browser tells a hundred at a time.
    const entries = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject));
    if (!entries.length) return found;
    for (const each of entries) found.push(...(await inside(each, `${name}/`)));
  }
}

export async function ofDrop(data: DataTransfer): Promise<Dropped[]> {
  const entries = [...data.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
  return (await Promise.all(entries.map((entry) => inside(entry, "")))).flat();
}

export function ofInput(files: FileList): Dropped[] {
  return [...files].map((file) => ({ name: file.webkitRelativePath || file.name, file }));
}

/** Without the one folder that all lie in, which says nothing; two folders are the sides of the row. */
export function withoutCommon(files: Dropped[]): Dropped[] {
  const first = files[0]?.name.split("/")[0];
  const common = files.length > 0 && files.every(({ name }) => name.includes("/") && name.split("/")[0] === first);
  return common ? withoutCommon(files.map(({ name, file }) => ({ name: name.slice(first!.length + 1), file }))) : files;
}

/** With names that their copies can have, each another one. */
export function withFitNames(files: Dropped[]): Dropped[] {
  const taken = new Set(files.map(({ name }) => name).filter((name) => copyName(name) === name));
  return files.map(({ name, file }) => {
    let fit = copyName(name);
    if (fit !== name) {
      while (taken.has(fit)) fit = fit.replace(/(\.[^./]*)$/, "-$1");
      taken.add(fit);
    }
    return { name: fit, file };
  });
}

/** Copy files to the server, one after another; returns the folder, or the video that was all there was. */
export async function copy(files: Dropped[], onProgress: (done: number, bytes: number, all: number) => void): Promise<string> {
  const drop = await tell<string>("drops");
  const all = files.reduce((sum, { file }) => sum + file.size, 0);
  let folder = "";
  let before = 0;
  for (const [i, { name, file }] of files.entries()) {
    folder = await send(`drops/${drop}/${name.split("/").map(encodeURIComponent).join("/")}`, file, (bytes) => onProgress(i, before + bytes, all));
    before += file.size;
    onProgress(i + 1, before, all);
  }
  const only = files.length === 1 ? files[0]!.name : "";
  return /\.(jpe?g|jpe|png|tiff?|hei[cf]|webp|bmp)$/i.test(only) || !only ? folder : `${folder}/${only}`;
}
