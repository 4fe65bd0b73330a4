/** Numbers and dates that Python wrote, as the reader's language writes them. */

export function localised(value: number, digits: number, locale?: string): string {
  return new Intl.NumberFormat(locale, { minimumFractionDigits: digits, maximumFractionDigits: digits }).format(value);
}

const formats = new Map<number, Intl.NumberFormat>();

/** A measurement or a number of something, without marks between thousands. */
export function measured(value: number, digits: number): string {
  let format = formats.get(digits);
  if (!format) formats.set(digits, (format = new Intl.NumberFormat(undefined, { minimumFractionDigits: digits, maximumFractionDigits: digits, useGrouping: false })));
  return format.format(value);
}

/** A number as short as it is, with three places at most, or so many figures that count. */
export function short(value: number, figures?: number): string {
  const digits = figures ? { maximumSignificantDigits: figures } : { maximumFractionDigits: 3 };
  return new Intl.NumberFormat(undefined, { ...digits, useGrouping: false }).format(value);
}

/** A day such as 2026-08-12, without a time zone. */
export function localisedDay(day: string, locale?: string): string {
  return new Intl.DateTimeFormat(locale, { dateStyle: "medium", timeZone: "UTC" }).format(new Date(`${day}T00:00:00Z`));
}

/** A text with the decimal fractions in it as the reader's language writes them; names of files stay as they are. */
export function localisedText(text: string, locale?: string): string {
  return text.replace(/(?<![\w./])\d+\.\d+(?=[ ,:]|$)/g, (number) => localised(Number(number), number.split(".")[1]!.length, locale));
}

export function localisePage(): void {
  for (const number of document.querySelectorAll<SVGTSpanElement>("tspan[data-value]")) {
    const digits = number.dataset.value!.split(".")[1]!.length;
    number.textContent = localised(Number(number.dataset.value), digits);
  }
  for (const hint of document.querySelectorAll("svg.plot title")) hint.textContent = localisedText(hint.textContent ?? "");
  for (const data of document.querySelectorAll<HTMLDataElement>("data[value]")) data.textContent = localised(Number(data.value), Number(data.dataset.digits ?? 0));
  for (const time of document.querySelectorAll<HTMLTimeElement>("time[datetime]")) time.textContent = localisedDay(time.dateTime);
}
