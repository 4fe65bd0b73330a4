/** The page's language: the browser's, unless a person chose; texts, numbers, days and times in it. */

import { LANGUAGES, type Texts } from "./texts";

const KEPT = "pomona-language";

export function languageOf(wanted: readonly string[]): string {
  return wanted.map((each) => each.split("-")[0]!).find((each) => each in LANGUAGES) ?? "en";
}

let language = languageOf([localStorage.getItem(KEPT) ?? "", ...navigator.languages]);

export function chooseLanguage(chosen: string): void {
  language = chosen;
  localStorage.setItem(KEPT, chosen);
  document.documentElement.lang = chosen;
}

export function current(): string {
  return language;
}

/** The texts in the present language. */
export function texts(): Texts {
  return LANGUAGES[language]!;
}

/** The browser's region where it speaks the page's language: 1.234,5 or 1’234.5. */
function locale(): string {
  return navigator.languages.find((each) => each.split("-")[0] === language) ?? language;
}

export function number(value: number, digits = 0): string {
  return new Intl.NumberFormat(locale(), { minimumFractionDigits: digits, maximumFractionDigits: digits }).format(value);
}

/** A day such as 2026-08-12, or a moment in ISO 8601. */
export function day(iso: string): string {
  return new Intl.DateTimeFormat(locale(), { dateStyle: "medium", timeZone: iso.length === 10 ? "UTC" : undefined }).format(new Date(iso));
}

export function duration(seconds: number): string {
  const t = texts();
  if (seconds < 55) return t.seconds(Math.max(1, seconds < 10 ? Math.ceil(seconds) : Math.round(seconds / 5) * 5));
  const minutes = Math.round(seconds / 60);
  return minutes < 60 ? t.minutes(minutes) : t.hours(Math.floor(minutes / 60), minutes % 60);
}

/** What the run does at this moment; what stands in brackets, such as the side of the row, stays. */
export function stepOf(label: string): string {
  const [, name, rest] = /^(.*?)( \(.*)?$/.exec(label)!;
  return `${texts().steps[name!] ?? name}${rest ?? ""}`;
}
