import { expect, it } from 'vitest';
import { extended, half95, merged, type Step, variance } from './moments';

const of = (values: number[]): Step => {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  return { n: values.length, mean, m2: values.reduce((sum, value) => sum + (value - mean) ** 2, 0) };
};

it('merging parts gives the moments of the whole', () => {
  const whole = of([1, 2, 4, 8, 16, 5]);
  const parts = merged(of([1, 2, 4]), of([8, 16, 5]));
  expect(parts.n).toBe(6);
  expect(parts.mean).toBeCloseTo(whole.mean);
  expect(parts.m2).toBeCloseTo(whole.m2);
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
