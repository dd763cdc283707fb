import { expect, it } from 'vitest';
import { carriers, extended, half95, logVarianceSpread, merged, type Step, variance } from './moments';
import { of } from './sample';

it('merging parts gives the moments of the whole', () => {
  const [first, second] = [[1, 2, 4, 0], [8, 16, 5, 0, 7]]; // prettier-ignore
  const whole = of([...first, ...second]);
  const parts = merged(of(first), of(second));
  expect([parts.n, parts.lit]).toEqual([9, 7]);
  for (const name of ['mean', 'm2', 'm3', 'm4'] as const) expect(parts[name] / whole[name]).toBeCloseTo(1, 12);
});

it('a further part goes on from the last step', () => {
  const steps = extended([of([1, 2])], [of([4]), of([4, 8])]);
  expect(steps.map((step) => step.n)).toEqual([2, 3, 4]);
  expect(steps.at(-1)!.mean).toBeCloseTo(3.75);
});

it('two samples make a first, wide interval', () => {
  expect(variance(of([3]))).toBeNaN();
  expect(half95(of([0, 2]))).toBeCloseTo(12.706, 2);
});

it('the variance is carried by all samples, or by the one that met the light', () => {
  expect(carriers(of([0, 2, 0, 2]))).toBeCloseTo(4);
  const rare: Step = of([...Array<number>(999).fill(0), 1000]);
  expect(carriers(rare)).toBeLessThan(1.01);
  expect(logVarianceSpread(rare)).toBeCloseTo(1, 2);
  // Of a normal variable the kurtosis is 3: Var[ln s²] = 2/n.
  const normal = of(Array.from({ length: 4000 }, (_, i) => Math.sqrt(-2 * Math.log((i + 0.5) / 4000)) * Math.cos(2.399963 * i)));
  expect(logVarianceSpread(normal) * 4000).toBeCloseTo(2, 0);
});
