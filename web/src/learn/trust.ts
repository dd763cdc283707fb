/** Whether a technique's numbers can be believed: samples alone cannot tell of light that none of them has met. Pure. */
import type { Technique } from '../api/types';
import { half95, type Step, variance, carriers } from './moments';
import type { Words } from './words/en';

/** Fewer samples that found light, or that carry the variance, and both the variance and its interval are guesses. */
export const ENOUGH = 30;

export type Trust = 'trusted' | 'dark' | 'few' | 'apart';

/** reference: what the technique is measured against, null for that itself. */
export function trustOf(step: Step, reference: Step | null): Trust {
  if (!(variance(step) > 0)) return 'dark';
  if (reference && Math.abs(step.mean - reference.mean) > half95(step) + half95(reference)) return 'apart';
  return Math.min(step.lit, carriers(step)) >= ENOUGH ? 'trusted' : 'few';
}

/** In a few words, for a mark; and as a sentence. */
export function trustInWords(trust: Trust, reference: Technique, words: Words): { mark: string; says: string } {
  return { mark: words.trust[trust], says: words.trustSays[trust](reference, ENOUGH) };
}
