import { expect, it } from 'vitest';
import type { CurvePoint, Job } from '../api/types';
import { efficiencyOf, inWords, type Rendered } from './efficiency';

/** Standard normal numbers, the same ones every time. */
function normals(seed: number): () => number {
  let state = seed;
  const uniform = (): number => ((state = (state * 1_664_525 + 1_013_904_223) >>> 0) + 0.5) / 2 ** 32;
  return () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
}

/** error² · time is `constant` after `start` seconds of start-up; `noise`: relative, of what each stretch brings. */
function curve(constant: number, { start = 0, noise = 0, seed = 1, points = 12, until = 16 } = {}): CurvePoint[] {
  const normal = normals(seed);
  let [work, before] = [0, start];
  return Array.from({ length: points }, (_, i) => {
    const seconds = start + until * 1.3 ** (i + 1 - points);
    work += ((seconds - before) / constant) * Math.max(1 + noise * normal(), 0.01);
    before = seconds;
    return { seconds, spp: seconds, error: 1 / Math.sqrt(work) };
  });
}

const job = (changes: object = {}, error_upper = 1.02): Job =>
  ({
    scene: { gallery: 'cornell-box', id: null }, target: { error: 0.02, confidence: null, region: null }, error: 1, error_upper,
    settings: { width: 64, height: 48, seed: 0, max_depth: null, technique: 'mis', adaptive: true, ...changes },
  }) as unknown as Job; // prettier-ignore
const rendered = (points: CurvePoint[], changes: object = {}): Rendered => ({ job: job(changes), curve: points, isWhole: true });
const bsdf = { technique: 'bsdf' };

it('half the error in the same time is four times the efficiency, start-up left aside', () => {
  const found = efficiencyOf(rendered(curve(0.01, { start: 3 })), rendered(curve(0.04), bsdf));
  expect(found).toMatchObject({ kind: 'ratio' });
  if (found.kind !== 'ratio') return;
  expect(found.ratio).toBeCloseTo(4);
  expect(found.low).toBeLessThan(4);
  expect(found.low).toBeGreaterThan(3.5);
  expect(inWords(found)).toMatch(/^A needs 3\.\d to 4\.\d times less render time than B for the same error, with 95 % confidence\.$/);
  const other = efficiencyOf(rendered(curve(0.04), bsdf), rendered(curve(0.01)));
  expect(inWords(other)).toMatch(/^B needs 3\.\d to 4\.\d times less/);
});

it('intervals hold the truth, and say nothing where they hold 1', () => {
  const runs = 400;
  let [missed, claimed] = [0, 0];
  for (let i = 0; i < runs; i++) {
    const noisy = (seed: number, constant: number): CurvePoint[] => curve(constant, { noise: 0.25, seed });
    const same = efficiencyOf(rendered(noisy(2 * i + 1, 0.01)), rendered(noisy(2 * i + 2, 0.01), bsdf));
    if (same.kind === 'ratio') claimed++;
    const found = efficiencyOf(rendered(noisy(2 * i + 1, 0.01)), rendered(noisy(2 * i + 2, 0.03), bsdf));
    if (found.kind === 'ratio' && (found.low > 3 || found.high < 3)) missed++;
  }
  // 5 % each are what is promised; more than 8 % of 400 are seen once in 150 times where it is kept.
  expect(claimed / runs).toBeLessThan(0.08);
  expect(missed / runs).toBeLessThan(0.08);
});

it.each([
  ['the same estimator with another seed and target', { seed: 9 }, true, 12, /same estimator/],
  ['two sizes', { ...bsdf, width: 32 }, true, 12, /sizes/i],
  ['a picture whose round is not finished', bsdf, false, 12, /every pixel/],
  ['a curve that has just begun', bsdf, true, 3, /points/],
])('nothing is said of %s', (_, changes, isWhole, points, why) => {
  const found = efficiencyOf(rendered(curve(0.01)), { ...rendered(curve(0.05, { points }), changes), isWhole });
  expect(found).toMatchObject({ kind: 'unsaid', why: expect.stringMatching(why) });
});

it('nothing is said of two scenes, two regions, or where the error itself is not known', () => {
  const a = rendered(curve(0.01));
  const against = (changes: object): Rendered => ({ ...rendered(curve(0.05), bsdf), job: { ...job(bsdf), ...changes } as Job });
  expect(efficiencyOf(a, against({ scene: { gallery: 'plates', id: null } }))).toMatchObject({ kind: 'unsaid' });
  expect(efficiencyOf(a, against({ target: { error: 0.02, region: [0, 0, 4, 4] } }))).toMatchObject({ kind: 'unsaid' });
  expect(efficiencyOf(a, against({ error: null, error_upper: null }))).toMatchObject({ kind: 'unsaid' });
});

it('an error that is hardly known widens the interval', () => {
  const wide = { ...rendered(curve(0.02), bsdf), job: job(bsdf, 2) };
  expect(efficiencyOf(rendered(curve(0.01)), wide)).toMatchObject({ kind: 'same' });
});
