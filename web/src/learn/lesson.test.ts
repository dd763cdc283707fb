import { expect, it } from 'vitest';
import { type AllSteps, bestOf, errorLines, estimateLines, rowsOf } from './lesson';
import type { Step } from './moments';

const steps = (variance: number): Step[] => [4, 16, 64, 256].map((n) => ({ n, mean: 2, m2: variance * (n - 1) }));
const all: AllSteps = { mis: steps(0.04), uniform: steps(4), emitter: [4, 16, 64, 256].map((n) => ({ n, mean: 0, m2: 0 })) };

it('what found no light is nothing to measure against', () => {
  expect(bestOf(all)?.technique).toBe('mis');
  expect(rowsOf(all).find((row) => row.technique === 'emitter')).toMatchObject({ forOnePercent: null, timesBest: null });
});

it('a hundred times the variance is a hundred times the samples', () => {
  const [mis, uniform] = ['mis', 'uniform'].map((name) => rowsOf(all).find((row) => row.technique === name)!);
  expect(mis.forOnePercent).toBeCloseTo(100);
  expect(uniform.forOnePercent).toBeCloseTo(10_000);
  expect(uniform.timesBest).toBeCloseTo(100);
});

it('curves share their columns, and the guide follows 1/√n through the best', () => {
  const lines = errorLines(all)!;
  expect(lines.x).toEqual([16, 64, 256]);
  expect(lines.guide![2]).toBeCloseTo(lines.guide![0]! / 4);
  expect(estimateLines(all, 'uniform')!.band!.high.every((high) => high! > 2)).toBe(true);
  expect(estimateLines({}, 'mis')).toBeNull();
});
