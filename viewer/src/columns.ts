/** Python's values as they travel (`stages/report/columns.py`): JSON, and behind it columns of numbers, which are not copied. */

const TYPES = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };

interface Column {
  column: keyof typeof TYPES;
  at: number;
  count: number;
}

const isColumn = (value: unknown): value is Column => typeof value === "object" && value !== null && "column" in value;

export function decode<T>(buffer: ArrayBuffer): T {
  const length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  return JSON.parse(text, (_, value: unknown) => (isColumn(value) ? new TYPES[value.column](buffer, 4 + length + value.at, value.count) : value)) as T;
}

export function fromBase64(text: string): ArrayBuffer {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes.buffer;
}

/** What a server says that answers, but does not do what it was asked for. */
export class Refused extends Error {
  static async of(answer: Response): Promise<Refused> {
    return new Refused((await answer.text()) || `${answer.url}: ${answer.status}`);
  }
}

/** Why something did not go, in words: what the server says, or that none answers. */
export function whyOf(error: unknown): string {
  return error instanceof Refused ? error.message : "is Pomona still running (pomona view or pomona app)?";
}

export async function fetched<T>(url: string): Promise<T> {
  const answer = await fetch(url);
  if (!answer.ok) throw await Refused.of(answer);
  return decode<T>(await answer.arrayBuffer());
}
