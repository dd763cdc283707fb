import { describe, expect, it } from 'vitest';
import { studentQuantile, t95, withinProbability } from './student';

describe('t95', () => {
  it.each([
    [1, 12.7062], [2, 4.30265], [3, 3.18245], [7, 2.36462], [10, 2.22814], [30, 2.04227], [120, 1.97993], [1000, 1.96234],
  ])('agrees with the printed table at %i degrees of freedom', (degrees, quantile) => {
    expect(t95(degrees)).toBeCloseTo(quantile, 4);
  }); // prettier-ignore

  it('passes smoothly from the exact sums to the expansion', () => {
    expect(t95(200) - t95(201)).toBeGreaterThan(0);
    expect(t95(200) - t95(201)).toBeLessThan(1e-4);
  });

  it('has no value below one degree of freedom', () => {
    expect(t95(0)).toBeNaN();
    expect(t95(Number.NaN)).toBeNaN();
  });
});

it('the probability of one degree of freedom is the Cauchy one', () => {
  expect(withinProbability(1, 1)).toBeCloseTo(0.5, 12);
});

it.each([
  [0.95, Infinity, 1.644854], [0.975, Infinity, 1.959964], [0.9999, Infinity, 3.719016], [0.5, Infinity, 0], [0.99, 5, 3.36493], [0.9, 1, 3.077684],
])('the quantile at %f with %f degrees of freedom is the printed one', (probability, degrees, quantile) => {
  expect(studentQuantile(probability, degrees)).toBeCloseTo(quantile, 4);
}); // prettier-ignore
