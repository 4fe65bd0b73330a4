/** Numbers as people type them. */

/**
 * The number in a field, which may have the field's unit behind it; null where the field is empty, NaN where it says
 * something else.
 */
export function numberIn(text: string, unit: string): number | null {
  const said = text.trim().replace(new RegExp(`\\s*${unit}$`, "i"), "");
  if (!text.trim()) return null;
  return /^\d+([.,]\d*)?$|^[.,]\d+$/.test(said) ? Number(said.replace(",", ".")) : NaN;
}
