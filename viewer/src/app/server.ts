/** What the page asks its server for. Whatever does not go comes back as an `Error` with what Pomona says. */

import type { Everything, Refusal } from "./contract";

/** The message of an error where nobody answers, whatever the browser calls that; it is shown in words. */
export const NO_ANSWER = "no answer";

async function reach(path: string, init?: RequestInit): Promise<Response> {
  try {
    return await fetch(`api/${path}`, init);
  } catch {
    throw new Error(NO_ANSWER);
  }
}

async function answer<T>(response: Response): Promise<T> {
  if (response.ok) return response.status === 204 ? (undefined as T) : ((await response.json()) as T);
  const text = await response.text();
  let message = text;
  try {
    message = (JSON.parse(text) as Refusal).message;
  } catch {
    // Plain text is the message itself.
  }
  throw new Error(message || `${response.status}`);
}

export async function ask<T>(path: string): Promise<T> {
  return answer<T>(await reach(path));
}

export async function tell<T>(path: string, values: unknown = {}): Promise<T> {
  const body = JSON.stringify(values);
  return answer<T>(await reach(path, { method: "POST", headers: { "Content-Type": "application/json" }, body }));
}

/** Save a file that the server makes, under the name that it gives. */
export async function download(path: string): Promise<void> {
  const response = await reach(path);
  if (!response.ok) await answer(response);
  const name = fileName(response.headers.get("Content-Disposition") ?? "");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await response.blob());
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** The name of a file in a Content-Disposition header: names that are not plain ASCII stand there encoded (RFC 6266). */
export function fileName(disposition: string): string {
  const encoded = /filename\*=utf-8''([^;]+)/i.exec(disposition)?.[1];
  return encoded ? decodeURIComponent(encoded) : (/filename="?([^";]+)/.exec(disposition)?.[1] ?? "pomona");
}

/** Send a file, saying how many bytes have gone. */
export function send(path: string, file: File, onSent: (bytes: number) => void): Promise<string> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", `api/${path}`);
    request.upload.onprogress = (event) => onSent(event.loaded);
    request.onerror = () => reject(new Error(NO_ANSWER));
    request.onload = () => {
      try {
        const values = JSON.parse(request.responseText) as string | Refusal;
        if (request.status === 200) resolve(values as string);
        else reject(new Error((values as Refusal).message));
      } catch {
        reject(new Error(request.responseText || String(request.status)));
      }
    };
    request.send(file);
  });
}

/** Whether the server answers; `ended`: another one does, which does not know this page's token. */
export type Answers = "yes" | "no" | "ended";

/** Be told the list of surveys, now and whenever it changes. Returns what ends it. */
export function listen(onNews: (everything: Everything) => void, onAnswers: (answers: Answers) => void): () => void {
  const source = new EventSource("api/events");
  source.onmessage = (event) => {
    onAnswers("yes");
    onNews(JSON.parse(event.data as string) as Everything);
  };
  source.onerror = () => onAnswers(source.readyState === EventSource.CLOSED ? "ended" : "no");
  return () => source.close();
}
