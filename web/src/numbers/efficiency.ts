/**
 * Which of two jobs is worth more per second, with its interval. Work done is 1 / error², which grows in proportion to render
 * time once the start is over; its growth per second is the efficiency. Read off the stretches of a curve's later part, whose
 * scatter tells how well it is known: noise of the errors and a machine that was not always equally fast are both in it.
 */
import type { CurvePoint, Job } from '../api/types';
import { studentQuantile } from './student';

export interface Rendered {
  job: Pick<Job, 'scene' | 'settings' | 'target' | 'error' | 'error_upper'>;
  curve: readonly CurvePoint[];
  /** Every pixel has two replicates: its own variance, not its neighbours'. */
  isWhole: boolean;
}

/** ratio: how many times as efficient A is as B; with a 95 % interval that does not hold 1, or `same` where it does. */
export type Efficiency =
  | { kind: 'ratio' | 'same'; ratio: number; low: number; high: number }
  | { kind: 'unsaid'; why: string };

const LATER = 1 / 8;
const MOST_STRETCHES = 8;
const LEAST_STRETCHES = 4;

export function efficiencyOf(a: Rendered, b: Rendered): Efficiency {
  const why = hindrance(a, b);
  if (why !== null) return { kind: 'unsaid', why };
  const [ofA, ofB] = [rateOf(a.curve), rateOf(b.curve)];
  const [ofErrorA, ofErrorB] = [errorSpread(a.job), errorSpread(b.job)];
  if (!ofA || !ofB) return { kind: 'unsaid', why: `The efficiency ratio comes once both curves have ${LEAST_STRETCHES + 1} points.` };
  if (ofErrorA === null || ofErrorB === null) return { kind: 'unsaid', why: 'The efficiency ratio comes once both errors are known.' };
  const spread = Math.hypot(ofA.spread, ofB.spread, 2 * ofErrorA, 2 * ofErrorB);
  const reach = studentQuantile(0.975, Math.min(ofA.stretches, ofB.stretches) - 1) * spread;
  const ratio = ofA.rate / ofB.rate;
  const [low, high] = [ratio * Math.exp(-reach), ratio * Math.exp(reach)];
  return { kind: low > 1 || high < 1 ? 'ratio' : 'same', ratio, low, high };
}

/** Why the two cannot be compared at all. */
function hindrance(a: Rendered, b: Rendered): string | null {
  const [first, second] = [a.job, b.job];
  if (first.scene.gallery !== second.scene.gallery || first.scene.id !== second.scene.id)
    return 'Two different scenes: their efficiencies say nothing of each other.';
  const { width, height } = first.settings;
  if (width !== second.settings.width || height !== second.settings.height)
    return 'Different sizes: their efficiencies cannot be compared.';
  if (String(first.target.region ?? '') !== String(second.target.region ?? ''))
    return 'Their errors count in different regions: their efficiencies cannot be compared.';
  if (isSameEstimator(first, second))
    return 'Both are the same estimator, so their efficiency is the same; their times differ by start-up and by what else the machine did.';
  if (!a.isWhole || !b.isWhole) return 'The efficiency ratio comes once every pixel of both has two replicates.';
  return null;
}

/** Seeds and targets decide which samples are taken and how many, not what each of them is worth. */
function isSameEstimator({ settings: a }: Rendered['job'], { settings: b }: Rendered['job']): boolean {
  const told = (settings: object): string =>
    JSON.stringify(Object.entries(settings).filter(([key]) => key !== 'seed').sort()); // prettier-ignore
  return told(a) === told(b);
}

/** Work per second over the later part of a curve, and its relative standard error by the jackknife over stretches. */
function rateOf(curve: readonly CurvePoint[]): { rate: number; spread: number; stretches: number } | null {
  const usable = curve.filter((point) => point.error > 0 && point.seconds > 0);
  const last = usable[usable.length - 1];
  const later = usable.filter((point) => point.seconds >= LATER * last.seconds);
  const stretches = stretchesOf(later.length > LEAST_STRETCHES ? later : usable);
  const m = stretches.length;
  if (m < LEAST_STRETCHES) return null;
  const seconds = stretches.reduce((sum, one) => sum + one.seconds, 0);
  const rate = stretches.reduce((sum, one) => sum + one.work, 0) / seconds;
  const residues = stretches.reduce((sum, one) => sum + (one.work - rate * one.seconds) ** 2, 0);
  return rate > 0 ? { rate, spread: Math.sqrt((residues * m) / (m - 1)) / seconds / rate, stretches: m } : null;
}

/** At most MOST_STRETCHES, each of several points where there are more. */
function stretchesOf(points: readonly CurvePoint[]): { seconds: number; work: number }[] {
  const count = Math.min(points.length - 1, MOST_STRETCHES);
  const ends = Array.from({ length: count + 1 }, (_, i) => points[Math.round((i * (points.length - 1)) / count)]);
  return ends.slice(1).map((end, i) => ({ seconds: end.seconds - ends[i].seconds, work: 1 / end.error ** 2 - 1 / ends[i].error ** 2 }));
}

/** Standard error of the logarithm of a job's error, from the bound that it is below with its target's confidence. */
function errorSpread({ error, error_upper, target }: Rendered['job']): number | null {
  if (!error || !error_upper) return null;
  const quantile = studentQuantile(target.confidence ?? 0.95, Infinity);
  return quantile > 0 ? Math.max(Math.log(error_upper / error), 0) / quantile : null;
}

/** In words, from the better one's side. */
export function inWords(found: Efficiency): string {
  if (found.kind === 'unsaid') return found.why;
  const times = (value: number): string => (value >= 9.5 ? String(Math.round(value)) : value.toFixed(1));
  const { ratio, low, high } = found;
  if (found.kind === 'same')
    return `Which of the two is more efficient cannot be told: A over B is ${times(low)} to ${times(high)}, with 95 % confidence.`;
  const [better, worse] = ratio > 1 ? ['A', 'B'] : ['B', 'A'];
  const [from, to] = ratio > 1 ? [low, high] : [1 / high, 1 / low];
  return `${better} needs ${times(from)} to ${times(to)} times less render time than ${worse} for the same error, with 95 % confidence.`;
}
