/** From numbers to places in a drawing: axes, curves, ticks. Pure. */

export interface Plane {
  x: (value: number) => number;
  y: (value: number) => number;
}

/** Round numbers within a range, about so many. */
export function ticks(low: number, high: number, about: number): number[] {
  const range = high - low;
  if (!(range > 0) || !Number.isFinite(range)) return [];
  const rough = range / Math.max(about, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough)!;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, i) => +((first + i) * step).toPrecision(12));
}

/** The range of what is known, with zero in it. */
export function rangeOf(values: readonly (number | null)[]): [number, number] {
  const known = values.filter((value): value is number => value !== null && Number.isFinite(value));
  const [low, high] = [Math.min(0, ...known), Math.max(0, ...known)];
  return low === high ? [0, 1] : [low, high];
}

/** A line through the points that are known; it breaks where one is not. */
export function pathOf(x: readonly number[], y: readonly (number | null)[], to: Plane): string {
  let isBegun = false;
  return x
    .map((value, i) => {
      const height = y[i];
      if (height === null) {
        isBegun = false;
        return '';
      }
      const command = isBegun ? 'L' : 'M';
      isBegun = true;
      return `${command}${to.x(value).toFixed(1)} ${to.y(height).toFixed(1)}`;
    })
    .join('');
}

/** As few digits as tell ticks apart. */
export const tickSaid = (value: number): string => {
  const magnitude = Math.abs(value);
  const text = magnitude !== 0 && (magnitude < 1e-3 || magnitude >= 1e5) ? value.toExponential(0) : String(+value.toPrecision(4));
  return text.replace('-', '−');
};
