/** Running moments of a technique's samples: parts merge in order (Chan, Golub and LeVeque 1979; Pébay 2008). */
import type { RunningMoments } from '../api/messages';
import { t95 } from '../numbers/student';

/** n samples: their mean, the sums of powers of their deviations, and how many found light. */
export type Step = RunningMoments;

/** Steps of all samples so far, after those of a further part. */
export function extended(steps: readonly Step[], part: readonly Step[]): Step[] {
  const before = steps.at(-1);
  return before ? [...steps, ...part.map((step) => merged(before, step))] : [...part];
}

export function merged(a: Step, b: Step): Step {
  const n = a.n + b.n;
  const delta = b.mean - a.mean;
  const [ofA, ofB] = [a.n / n, b.n / n];
  const both = delta * delta * ofA * ofB;
  return {
    n,
    mean: a.mean + delta * ofB,
    m2: a.m2 + b.m2 + n * both,
    m3: a.m3 + b.m3 + n * both * delta * (ofA - ofB) + 3 * delta * (ofA * b.m2 - ofB * a.m2),
    m4:
      a.m4 + b.m4 + n * both * delta * delta * (ofA * ofA - ofA * ofB + ofB * ofB) +
      6 * delta * delta * (ofA * ofA * b.m2 + ofB * ofB * a.m2) + 4 * delta * (ofA * b.m3 - ofB * a.m3),
    lit: a.lit + b.lit,
  }; // prettier-ignore
}

/** Variance of one sample; NaN below two. */
export const variance = ({ n, m2 }: Step): number => (n > 1 ? m2 / (n - 1) : Number.NaN);

export const standardError = (step: Step): number => Math.sqrt(variance(step) / step.n);

/** Half-width of the 95 % interval. */
export const half95 = (step: Step): number => standardError(step) * t95(step.n - 1);

/** How many samples carry the variance: (Σd²)² / Σd⁴, n where all are equally far from the mean, 1 where one is alone. */
export const carriers = ({ m2, m4 }: Step): number => (m4 > 0 ? (m2 * m2) / m4 : 0);

/** Variance of the logarithm of the variance, to first order: (kurtosis − 1) / n. */
export const logVarianceSpread = (step: Step): number => Math.max(1 / carriers(step) - 1 / step.n, 0);
