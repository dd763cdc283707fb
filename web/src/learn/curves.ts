/** From running moments to what the Learn view draws and says. Pure. */
import type { Technique } from '../api/types';
import { percent } from '../numbers/format';
import type { Lines } from './lines';
import { half95, logVarianceSpread, standardError, type Step, variance } from './moments';
import { type Trust, trustOf } from './trust';

export type AllSteps = Partial<Record<Technique, Step[]>>;

interface Curve {
  technique: Technique;
  steps: Step[];
  last: Step;
}

const curvesOf = (all: AllSteps): Curve[] =>
  (Object.entries(all) as [Technique, Step[]][]).filter(([, steps]) => steps.length > 2).map(([technique, steps]) => ({ technique, steps, last: steps[steps.length - 1] }));

/**
 * What the others are measured against: `mis`, which misses no light that either of its techniques can find. A small
 * standard error alone is no sign: a technique that has not met a rare light yet has one too.
 */
export function bestOf(all: AllSteps): { technique: Technique; step: Step } | null {
  const able = curvesOf(all).filter(({ last }) => last.m2 > 0);
  const best = able.find(({ technique }) => technique === 'mis') ?? able[0];
  return best ? { technique: best.technique, step: best.last } : null;
}

const columns = (curves: Curve[]): number[] => [...new Set(curves.flatMap(({ steps }) => steps.map((step) => step.n)))].sort((a, b) => a - b);

function column(x: readonly number[], steps: readonly Step[], value: (step: Step) => number): (number | null)[] {
  const byCount = new Map(steps.map((step) => [step.n, value(step)]));
  return x.map((n) => {
    const found = byCount.get(n);
    return found === undefined || !Number.isFinite(found) ? null : found;
  });
}

/** Estimates over samples, with the interval of one technique. */
export function estimateLines(all: AllSteps, banded: Technique): Lines | null {
  const curves = curvesOf(all);
  const best = bestOf(all);
  if (!best) return null;
  const x = columns(curves).filter((n) => n >= 8);
  // Room for the techniques that are not hopeless: six standard errors of the median one at 256 samples.
  const spreads = curves.map(({ last }) => Math.sqrt(variance(last) / 256)).filter((spread) => spread > 0).sort((a, b) => a - b);
  const room = Math.max(6 * standardError(best.step), 2 * (spreads[Math.floor(spreads.length / 2)] ?? 0));
  const steps = all[banded] ?? [];
  return {
    x,
    curves: curves.map(({ technique, steps }) => ({ technique, y: column(x, steps, (step) => step.mean) })),
    band: { technique: banded, low: column(x, steps, (step) => step.mean - half95(step)), high: column(x, steps, (step) => step.mean + half95(step)) },
    guide: null,
    yRange: [best.step.mean - room, best.step.mean + room],
    isLog: false,
    shows: (value) => String(+value.toPrecision(3)).replace('-', '−'),
  };
}

/** Standard error over the best mean, over samples: straight lines of slope −1/2 on logarithmic axes. */
export function errorLines(all: AllSteps): Lines | null {
  const curves = curvesOf(all);
  const best = bestOf(all);
  if (!best || best.step.mean <= 0) return null;
  const x = columns(curves).filter((n) => n >= 8);
  const relative = (step: Step): number => {
    const error = standardError(step) / best.step.mean;
    return error > 0 ? error : Number.NaN;
  };
  const drawn = curves.map(({ technique, steps }) => ({ technique, y: column(x, steps, relative) }));
  const values = drawn.flatMap(({ y }) => y.filter((value) => value !== null));
  if (values.length === 0) return null;
  const law = relative(best.step) * Math.sqrt(best.step.n);
  return {
    x,
    curves: drawn,
    band: null,
    guide: x.map((n) => law / Math.sqrt(n)),
    yRange: [Math.min(...values) / 1.4, Math.max(...values) * 1.4],
    isLog: true,
    shows: (value) => percent(value, 1),
  };
}

/** A measured number with its 95 % interval. */
export interface Measured {
  value: number;
  low: number;
  high: number;
}

export interface Row {
  technique: Technique;
  mean: number;
  half: number;
  standardError: number;
  /** Of one sample; 0 where no light was found. */
  variance: number;
  /** Factor by which the variance may be off to either side, with 95 % confidence; NaN where that is not known. */
  spread: number;
  trust: Trust;
  /** Samples for a standard error of 1 % of the best mean. */
  forOnePercent: Measured | null;
  /** Times the variance of what the others are measured against; null for that itself, and where it is not known. */
  timesBest: Measured | null;
}

const Z95 = 1.96;

const within = (value: number, logSpread: number): Measured => {
  const factor = Math.exp(Z95 * Math.sqrt(logSpread));
  return { value, low: value / factor, high: value * factor };
};

export function rowsOf(all: AllSteps): Row[] {
  const best = bestOf(all);
  const isBestTrusted = best !== null && trustOf(best.step, null) === 'trusted';
  return curvesOf(all).map(({ technique, last }) => {
    const isBest = technique === best?.technique;
    const trust = trustOf(last, isBest ? null : (best?.step ?? null));
    const own = variance(last);
    const isKnown = trust === 'trusted' && best !== null && isBestTrusted;
    return {
      technique,
      mean: last.mean,
      half: half95(last),
      standardError: standardError(last),
      variance: own,
      spread: trust === 'trusted' ? Math.exp(Z95 * Math.sqrt(logVarianceSpread(last))) : Number.NaN,
      trust,
      forOnePercent: isKnown && best.step.mean > 0 ? within(own / (0.01 * best.step.mean) ** 2, logVarianceSpread(last)) : null,
      timesBest: isKnown && !isBest ? within(own / variance(best.step), logVarianceSpread(last) + logVarianceSpread(best.step)) : null,
    };
  });
}

/** The row that is surely worse than the best by most; null where none surely is. */
export function worstOf(rows: readonly Row[]): Row | null {
  const worse = rows.filter((row) => row.timesBest !== null && row.timesBest.low > 1);
  return worse.length > 0 ? worse.reduce((worst, row) => (row.timesBest!.value > worst.timesBest!.value ? row : worst)) : null;
}

/** A logarithmic axis in whole decades that holds every variance: a value's place from 0 to 1, and where the numbers stand. */
export interface Axis {
  at: (value: number) => number;
  ticks: { value: number; at: number }[];
}

const MOST_TICKS = 6;

export function axisOf(rows: readonly Pick<Row, 'variance' | 'spread'>[]): Axis | null {
  const known = rows.filter((row) => row.variance > 0);
  if (known.length === 0) return null;
  const reach = (row: Pick<Row, 'variance' | 'spread'>): number => Math.log10(Math.min(row.spread || 1, 1e3));
  // A bar has a length, also the shortest one.
  const from = Math.floor(Math.min(...known.map((row) => Math.log10(row.variance) - reach(row))) - 0.1);
  const to = Math.max(Math.ceil(Math.max(...known.map((row) => Math.log10(row.variance) + reach(row))) + 0.02), from + 2);
  const at = (value: number): number => Math.min(Math.max((Math.log10(value) - from) / (to - from), 0), 1);
  const step = Math.ceil((to - from) / MOST_TICKS);
  const decades = Array.from({ length: Math.floor((to - from) / step) + 1 }, (_, i) => from + i * step);
  return { at, ticks: decades.map((decade) => ({ value: 10 ** decade, at: at(10 ** decade) })) };
}
