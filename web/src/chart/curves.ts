/** Columns for the convergence chart. Error over render time on two log axes; nothing here draws. */
import type { CurvePoint, Forecast } from '../api/types';
import { rootLaw } from '../numbers/forecast';

export interface ChartData {
  /** Seconds, ascending. */
  x: number[];
  error: (number | null)[];
  /** What the error is below, with the target's confidence: the stop rule judges it. */
  bound: (number | null)[];
  /** The curve compared with, if any. */
  other: (number | null)[];
  root: (number | null)[];
  target: (number | null)[];
  /** Where the forecast expects the target: seconds, with its interval. */
  expected: { at: number; low: number; high: number } | null;
  xRange: [number, number];
  yRange: [number, number];
}

const STEPS = [1, 2, 5];
const DURATIONS = [60, 120, 300, 600, 1200, 1800, 3600, 7200, 18_000, 36_000, 86_400, 172_800, 432_000, 864_000];

export function chartData(
  curve: readonly CurvePoint[],
  target: number | null,
  forecast: Forecast | null,
  against: readonly CurvePoint[] = [],
): ChartData | null {
  const isShown = (point: CurvePoint): boolean => point.error > 0 && point.seconds > 0;
  const points = curve.filter(isShown);
  const others = against.filter(isShown);
  if (points.length === 0) return null;
  const first = Math.min(points[0].seconds, others[0]?.seconds ?? Infinity);
  const last = points[points.length - 1].seconds;
  const left = forecast?.seconds_left ?? null;
  const expected =
    target !== null && left !== null
      ? { at: last + left, low: last + Math.max(forecast?.low ?? left, 0), high: last + Math.min(forecast?.high ?? left, 50 * last) }
      : null;
  const longest = Math.max(last, others.at(-1)?.seconds ?? 0);
  const end = expected ? Math.max(Math.min(Math.max(expected.at, expected.high), 100 * last), longest) : longest * 1.15;
  const law = rootLaw(points);
  const xRange: [number, number] = [first / 1.25, Math.max(end * 1.1, first * 4)];
  const x = [...new Set([xRange[0], ...[...points, ...others].map((point) => point.seconds), end, xRange[1]])].sort((a, b) => a - b);
  const byTime = new Map(points.map((point) => [point.seconds, point.error]));
  const bounds = new Map(points.map((point) => [point.seconds, point.upper ?? null]));
  const byTimeOfOther = new Map(others.map((point) => [point.seconds, point.error]));
  const errors = [...points, ...others].map((point) => point.error);
  const highestBound = Math.max(0, ...[...bounds.values()].map((bound) => bound ?? 0));
  const lowest = Math.min(...errors, target ?? Infinity);
  const highest = Math.max(...errors, highestBound, target ?? 0);
  return {
    x,
    error: x.map((seconds) => byTime.get(seconds) ?? null),
    bound: x.map((seconds) => bounds.get(seconds) ?? null),
    other: x.map((seconds) => byTimeOfOther.get(seconds) ?? null),
    root: x.map((seconds) => (law === null ? null : law / Math.sqrt(seconds))),
    target: x.map(() => target),
    expected,
    xRange,
    yRange: [lowest / 1.5, Math.max(highest * 1.4, (lowest / 1.5) * 4)],
  };
}

/** Round values 1, 2, 5 per decade inside [low, high]; whole decades only where that would be more than `most`. */
export function logTicks(low: number, high: number, most: number): number[] {
  const from = Math.floor(Math.log10(low));
  const to = Math.ceil(Math.log10(high));
  const ticks = (steps: readonly number[]): number[] => {
    const values: number[] = [];
    for (let decade = from; decade <= to; decade++) {
      for (const step of steps) values.push(step * 10 ** decade);
    }
    return values.map((value) => +value.toPrecision(6)).filter((value) => value >= low && value <= high);
  };
  for (const steps of [STEPS, [1, 3], [1]]) {
    const values = ticks(steps);
    if (values.length <= most) return values;
  }
  return ticks([1]).filter((_, index) => index % 2 === 0);
}

/** Round durations: 1, 2, 5, … 20 s, then minutes and hours instead of powers of ten. */
export function timeTicks(low: number, high: number, most: number): number[] {
  const seconds = logTicks(Math.min(low, 50), Math.min(high, 50), 100).filter((value) => value >= low && value <= high);
  const all = [...seconds.filter((value) => value <= 30), ...DURATIONS.filter((value) => value >= low && value <= high)];
  const stride = Math.max(1, Math.ceil(all.length / Math.max(most, 1)));
  return all.filter((_, index) => index % stride === 0);
}

/** The chart in one sentence, for those who do not see it. */
export function inWords(
  curve: readonly CurvePoint[],
  target: number | null,
  say: { percent: (value: number) => string; duration: (seconds: number) => string },
): string {
  const points = curve;
  if (points.length === 0) return 'No error has been measured yet.';
  const first = points[0];
  const last = points[points.length - 1];
  const fall =
    points.length === 1
      ? `The relative error is ${say.percent(last.error)} after ${say.duration(last.seconds)}.`
      : `The relative error fell from ${say.percent(first.error)} after ${say.duration(first.seconds)} to ` +
        `${say.percent(last.error)} after ${say.duration(last.seconds)}.`;
  if (target === null) return fall;
  const decides = last.upper ? `; the bound, which decides, is ${say.percent(last.upper)}` : '';
  return `${fall} The target is ${say.percent(target)}${decides}.`;
}
