/** From measured settings to curves and figures of the Learn view's trade. Pure. */
import type { TradeSetting } from '../api/messages';
import type { Curve } from './LogPlot.svelte';

/** Colour and dash by place: never colour alone. */
const LOOKS: readonly { token: string; dash: readonly number[] }[] = [
  { token: '--accent', dash: [] },
  { token: '--warn', dash: [8, 3] },
  { token: '--ok', dash: [5, 3] },
  { token: '--second', dash: [2, 3] },
  { token: '--secondary', dash: [1, 3] },
  { token: '--bad', dash: [10, 3, 2, 3] },
];
export const lookOf = (i: number): { token: string; dash: readonly number[] } => LOOKS[i % LOOKS.length];

/** Squared errors over time, with the squares of their intervals. */
export const curvesOf = (settings: readonly TradeSetting[]): Curve[] =>
  settings
    .map((setting, i) => ({ name: setting.name, ...lookOf(i), points: setting.curve.map(({ seconds, error, low, high }) => ({ x: seconds, y: error ** 2, low: low ** 2, high: high ** 2 })) }))
    .filter(({ points }) => points.length > 0);

/** Whether an interval of a ratio leaves 1 out: to which side; null where it is not known. */
export function sideOf({ times, times_low: low, times_high: high }: Pick<TradeSetting, 'times' | 'times_low' | 'times_high'>): 'more' | 'less' | 'equal' | null {
  if (times === null || low === null || high === null) return null;
  return low > 1 ? 'more' : high < 1 ? 'less' : 'equal';
}

/** Places of ratios on a logarithmic track in per cent: 1 has one, and all of them fit. */
export function trackOf(settings: readonly Pick<TradeSetting, 'times' | 'times_low' | 'times_high'>[]): (ratio: number) => number {
  const all = settings.flatMap(({ times, times_low: low, times_high: high }) => [times, low, high]).filter((value): value is number => value !== null && value > 0);
  const [from, to] = [Math.min(0.5, ...all) / 1.1, Math.max(2, ...all) * 1.05];
  return (ratio) => (100 * Math.min(Math.max(Math.log(ratio / from), 0), Math.log(to / from))) / Math.log(to / from);
}
