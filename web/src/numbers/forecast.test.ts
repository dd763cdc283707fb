import { expect, it } from 'vitest';
import type { Job } from '../api/types';
import { fractionDone, outcome, rootLaw, targetInShort, targetSentence, timeLeft } from './forecast';

const spaced = (text: string | null): string => (text ?? '').replace(/[\u202f\u00a0]/g, ' ');
const running = {
  state: 'running' as const, error: 0.04, seconds: 10, spp: 64, forecast: null, stopped_by: null,
  target: { error: 0.02, seconds: 100, spp: null },
}; // prettier-ignore

it('halving the error is a quarter of the work', () => {
  expect(fractionDone(running)).toBeCloseTo(0.25);
});

it('the target met first decides how far a job is', () => {
  expect(fractionDone({ ...running, target: { error: 0.02, seconds: 20 } })).toBeCloseTo(0.5);
  expect(fractionDone({ ...running, error: null, target: { error: 0.02 } })).toBe(0);
});

it('the 1/√n law goes through an ideal curve', () => {
  const curve = [1, 2, 4, 8].map((seconds) => ({ seconds, spp: seconds, error: 0.3 / Math.sqrt(seconds) }));
  expect(rootLaw(curve)).toBeCloseTo(0.3);
  expect(rootLaw(curve.slice(0, 1))).toBeNull();
});

it('nothing is foretold before the service does, but a time limit is', () => {
  expect(spaced(timeLeft(running))).toBe('at most 2 min of rendering left');
  expect(timeLeft({ ...running, target: { error: 0.02 } })).toBeNull();
  const forecast = { seconds_left: 30, low: 22, high: 45 };
  expect(spaced(timeLeft({ ...running, forecast }))).toBe('about 30 s of rendering left (20 s to 45 s)');
  expect(spaced(timeLeft({ ...running, forecast: { seconds_left: 600, low: 1, high: 900 } }))).toBe('about 2 min of rendering left');
  expect(spaced(timeLeft({ ...running, forecast: { seconds_left: null, low: 1, high: null } }))).toBe('at most 2 min of rendering left');
});

it('a target is said back in one sentence', () => {
  expect(spaced(targetSentence({ error: 0.02 }))).toBe('Stops when the relative error is at most 2 %.');
  expect(spaced(targetSentence({ error: 0.025, seconds: 600 }))).toBe(
    'Stops when the relative error is at most 2.5 % or 10 min of rendering have passed, whichever comes first.',
  );
  expect(targetSentence({})).toContain('at least one target');
  expect(spaced(targetSentence({ error: 0.02, confidence: 0.99, share: 0.9 }))).toBe(
    'Stops when the relative error of 90 % of the pixels, each by itself, is, 99 % sure, at most 2 %.',
  );
  expect(spaced(targetSentence({ error: 0.02, region: [1, 2, 3, 4] }))).toBe('Stops when the relative error in 3 × 4 pixels at (1, 2) is at most 2 %.');
  expect(spaced(targetInShort({ error: 0.02, spp: 64 }))).toBe('2 % or 64 spp');
});

it('an end is told by what ended it', () => {
  const ended = (changes: Partial<Job>): string =>
    spaced(outcome({ ...running, state: 'succeeded', error: 0.026, seconds: 112, ...changes }));
  expect(ended({ stopped_by: 'error', error: 0.02 })).toBe('Reached 2.0 % in 1 min 52 s');
  expect(ended({ stopped_by: 'seconds' })).toBe('Time used up: 2.6 %, target was 2 %');
  expect(ended({ stopped_by: 'spp', target: { spp: 64 } })).toBe('All samples taken: 2.6 %');
  expect(ended({ stopped_by: 'seconds', error: null })).toBe('Time used up: the error is not known, target was 2 %');
  expect(ended({ stopped_by: null, error: null })).toBe('Ended after 1 min 52 s: the error is not known');
  expect(ended({ state: 'cancelled', stopped_by: 'cancelled', error: null })).toBe('Cancelled after 1 min 52 s');
});
