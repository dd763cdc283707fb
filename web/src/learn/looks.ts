/** Colour and mark of each technique: never colour alone. */
import type { Technique } from '../api/types';

export const LOOKS: Record<Technique, { token: string; dash: number[]; mark: 'dot' | 'square' | 'cross' | 'ring'; says: string }> = {
  mis: { token: '--accent', dash: [], mark: 'dot', says: 'bsdf and emitter together, weighted' },
  emitter: { token: '--warn', dash: [8, 3], mark: 'square', says: 'points on the lights' },
  bsdf: { token: '--ok', dash: [5, 3], mark: 'cross', says: 'directions the surface likes' },
  cosine: { token: '--second', dash: [2, 3], mark: 'ring', says: 'more around the normal' },
  uniform: { token: '--secondary', dash: [1, 3], mark: 'dot', says: 'every direction alike' },
};
