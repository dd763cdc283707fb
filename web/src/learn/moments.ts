/** Running moments of a technique's samples: parts merge in order (Chan, Golub and LeVeque 1979). */
import type { RunningMoments } from '../api/messages';
import { t95 } from '../numbers/student';

export interface Step {
  n: number;
  mean: number;
  /** Sum of squared deviations. */
  m2: number;
}

/** Steps of all samples so far, after those of a further part. */
export function extended(steps: readonly Step[], part: readonly RunningMoments[]): Step[] {
  const before = steps.at(-1);
  return before ? [...steps, ...part.map((step) => merged(before, step))] : [...part];
}

export function merged(a: Step, b: Step): Step {
  const n = a.n + b.n;
  const delta = b.mean - a.mean;
  return { n, mean: a.mean + (delta * b.n) / n, m2: a.m2 + b.m2 + (delta * delta * a.n * b.n) / n };
}

/** Variance of one sample; NaN below two. */
export const variance = ({ n, m2 }: Step): number => (n > 1 ? m2 / (n - 1) : Number.NaN);

export const standardError = (step: Step): number => Math.sqrt(variance(step) / step.n);

/** Half-width of the 95 % interval. */
export const half95 = (step: Step): number => standardError(step) * t95(step.n - 1);
