/** From running moments to what the Learn view draws and says. Pure. */
import type { Technique } from '../api/types';
import { percent } from '../numbers/format';
import type { Lines } from './lines';
import { half95, standardError, type Step, variance } from './moments';

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

export interface Row {
  technique: Technique;
  mean: number;
  half: number;
  standardError: number;
  /** Of one sample; 0 where no light was found. */
  variance: number;
  /** Samples for a standard error of 1 % of the best mean. */
  forOnePercent: number | null;
  /** Times the variance of what the others are measured against. */
  timesBest: number | null;
}

export function rowsOf(all: AllSteps): Row[] {
  const best = bestOf(all);
  return curvesOf(all).map(({ technique, last }) => {
    const own = variance(last);
    const hasFound = own > 0;
    return {
      technique,
      mean: last.mean,
      half: half95(last),
      standardError: standardError(last),
      variance: own,
      forOnePercent: hasFound && best && best.step.mean > 0 ? own / (0.01 * best.step.mean) ** 2 : null,
      timesBest: hasFound && best ? own / variance(best.step) : null,
    };
  });
}
