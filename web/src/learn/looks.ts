/** Colour and mark of each technique: never colour alone. */
import type { Technique } from '../api/types';

export const LOOKS: Record<Technique, { token: string; dash: number[]; mark: 'dot' | 'square' | 'cross' | 'ring' }> = {
  mis: { token: '--accent', dash: [], mark: 'dot' },
  emitter: { token: '--warn', dash: [8, 3], mark: 'square' },
  bsdf: { token: '--ok', dash: [5, 3], mark: 'cross' },
  cosine: { token: '--second', dash: [2, 3], mark: 'ring' },
  uniform: { token: '--secondary', dash: [1, 3], mark: 'dot' },
};
