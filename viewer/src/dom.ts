/** Making and finding elements. Text is only ever set as text: names of files are never read as HTML. */

export function find<T extends Element = HTMLElement>(selector: string, within: ParentNode = document): T {
  const element = within.querySelector<T>(selector);
  if (!element) throw new Error(`The page lacks ${selector}`);
  return element;
}

export function element<K extends keyof HTMLElementTagNameMap>(tag: K, text = "", className = ""): HTMLElementTagNameMap[K] {
  const made = document.createElement(tag);
  if (text) made.textContent = text;
  if (className) made.className = className;
  return made;
}

export function button(text: string, label: string, onClick: () => void, className = ""): HTMLButtonElement {
  const made = element("button", text, className);
  made.type = "button";
  if (label) made.setAttribute("aria-label", label);
  made.addEventListener("click", onClick);
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

export function svg<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Record<string, string>): SVGElementTagNameMap[K] {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

/** A closed path through points x, y, x, y … */
export function pathOf(outline: ArrayLike<number>): string {
  let path = "";
  for (let i = 0; i + 1 < outline.length; i += 2) path += `${i ? "L" : "M"}${outline[i]!.toFixed(1)} ${outline[i + 1]!.toFixed(1)}`;
  return path && `${path}Z`;
}

/** Say something to screen readers. */
export function say(text: string): void {
  find("#live").textContent = text;
}
