/** Which of two jobs is worth more per second: efficiency = 1 / (error² · seconds), read off their curves. */
import type { CurvePoint } from '../api/types';
import { rootLaw } from './forecast';

/** How many times as efficient A is as B; null until both curves tell. Error² · time is constant under the 1/√n law. */
export function efficiencyRatio(a: readonly CurvePoint[], b: readonly CurvePoint[]): number | null {
  const [ofA, ofB] = [rootLaw(a), rootLaw(b)];
  return ofA === null || ofB === null ? null : (ofB / ofA) ** 2;
}

/** In words, from the better one's side. */
export function ratioInWords(ratio: number): string {
  const times = (value: number): string => (value >= 9.5 ? String(Math.round(value)) : value.toFixed(1));
  if (ratio > 0.95 && ratio < 1.05) return 'A and B need about the same time for the same error.';
  return ratio > 1
    ? `A needs ${times(ratio)} times less render time than B for the same error.`
    : `B needs ${times(1 / ratio)} times less render time than A for the same error.`;
}
