import { expect, it } from 'vitest';
import { axisOf, type AllSteps, bestOf, errorLines, estimateLines, rowsOf, worstOf } from './curves';
import type { Step } from './moments';
import { of } from './sample';
import { trustOf } from './trust';

/** Steps of samples of such a variance around a mean; kurtosis of a normal variable. */
const steps = (variance: number, mean = 2): Step[] =>
  [4, 16, 64, 256].map((n) => ({ n, mean, m2: variance * (n - 1), m3: 0, m4: (3 * (variance * (n - 1)) ** 2) / n, lit: n }));
const dark = [4, 16, 64, 256].map((n) => ({ n, mean: 0, m2: 0, m3: 0, m4: 0, lit: 0 }));
const all: AllSteps = { mis: steps(0.04), uniform: steps(4), emitter: dark };
const row = (name: string, of = all) => rowsOf(of).find((entry) => entry.technique === name)!;

it('what found no light is nothing to measure against', () => {
  expect(bestOf(all)?.technique).toBe('mis');
  expect(row('emitter')).toMatchObject({ forOnePercent: null, timesBest: null, trust: 'dark' });
});

it('a hundred times the variance is a hundred times the samples, with the interval of both', () => {
  expect(row('mis').forOnePercent!.value).toBeCloseTo(100);
  expect(row('uniform').forOnePercent!.value).toBeCloseTo(10_000);
  const { value, low, high } = row('uniform').timesBest!;
  expect(value).toBeCloseTo(100);
  // Var[ln s²] = 2/n for each of the two.
  expect(Math.log(high / value)).toBeCloseTo(1.96 * Math.sqrt(4 / 256), 1);
  expect(low * high).toBeCloseTo(value ** 2);
  expect(row('mis').timesBest).toBeNull();
});

it('no ratio is said of a technique that has not met the light, or that a few samples carry', () => {
  const missed = { ...all, uniform: steps(0.5, 1) }; // its interval and that of mis exclude each other
  expect(row('uniform', missed)).toMatchObject({ trust: 'apart', timesBest: null, forOnePercent: null });
  const rare = { ...all, uniform: [...steps(4).slice(0, 3), of([...Array<number>(254).fill(1.9), 20, 9])] };
  expect(row('uniform', rare)).toMatchObject({ trust: 'few', timesBest: null });
  expect(worstOf(rowsOf(missed))).toBeNull();
  expect(worstOf(rowsOf(all))?.technique).toBe('uniform');
});

it('trust needs samples that found light', () => {
  const light = { ...steps(4)[3], lit: 12 };
  expect(trustOf(light, null)).toBe('few');
  expect(trustOf({ ...light, lit: 200 }, null)).toBe('trusted');
});

it('bars lie on one logarithmic axis with numbers, none cut off', () => {
  const axis = axisOf([row('mis'), row('uniform'), { ...row('uniform'), variance: 570 * 0.04, spread: 2 }])!;
  const [small, middle, large] = [0.04, 4, 22.8].map(axis.at);
  expect(axis.ticks.map((tick) => tick.value)).toEqual([0.01, 0.1, 1, 10, 100]);
  expect((middle - small) / (large - small)).toBeCloseTo(Math.log10(100) / Math.log10(570));
  for (const at of [small, middle, large]) {
    expect(at).toBeGreaterThan(0);
    expect(at).toBeLessThan(1);
  }
  expect(axisOf([row('emitter')])).toBeNull();
});

it('curves share their columns, and the guide follows 1/√n through the best', () => {
  const lines = errorLines(all)!;
  expect(lines.x).toEqual([16, 64, 256]);
  expect(lines.guide![2]).toBeCloseTo(lines.guide![0]! / 4);
  expect(estimateLines(all, 'uniform')!.band!.high.every((high) => high! > 2)).toBe(true);
  expect(estimateLines({}, 'mis')).toBeNull();
});
