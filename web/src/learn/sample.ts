/** Moments of samples written down, for tests. */
import type { Step } from './moments';

export function of(values: readonly number[]): Step {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  const power = (exponent: number): number => values.reduce((sum, value) => sum + (value - mean) ** exponent, 0);
  return { n: values.length, mean, m2: power(2), m3: power(3), m4: power(4), lit: values.filter((value) => value !== 0).length };
}
