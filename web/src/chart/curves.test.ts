import { expect, it } from 'vitest';
import { chartData, inWords, logTicks, timeTicks } from './curves';

const curve = [1, 2, 4, 8].map((seconds) => ({ seconds, spp: 4 * seconds, error: 0.2 / Math.sqrt(seconds) }));

it('lays curve, law and target over the same times', () => {
  const data = chartData(curve, 0.02, { seconds_left: 92, low: 80, high: 110 })!;
  expect(data.expected).toEqual({ at: 100, low: 88, high: 118 });
  for (const column of [data.error, data.root, data.target]) expect(column).toHaveLength(data.x.length);
  expect(data.error.filter((value) => value !== null)).toHaveLength(4);
  expect(data.x).toEqual([...data.x].sort((a, b) => a - b));
  expect(data.xRange[1]).toBeGreaterThan(118);
  expect(data.yRange[0]).toBeLessThan(0.02);
});

it('shows nothing before the first measured error', () => {
  expect(chartData([], 0.02, null)).toBeNull();
  expect(chartData(curve, null, { seconds_left: null, low: null, high: null })!.expected).toBeNull();
});

it('a second curve has its own column over times of both', () => {
  const against = [3, 16].map((seconds) => ({ seconds, spp: seconds, error: 0.4 }));
  const data = chartData(curve, null, null, against)!;
  expect(data.other.filter((value) => value !== null)).toEqual([0.4, 0.4]);
  expect(data.error.filter((value) => value !== null)).toHaveLength(4);
  expect(data.xRange[1]).toBeGreaterThan(16);
  expect(data.yRange[1]).toBeGreaterThan(0.4);
});

it('the bound that the stop rule judges is drawn above the curve, and has room', () => {
  const bounded = curve.map((point, i) => ({ ...point, upper: i === 1 ? null : 1.5 * point.error }));
  const data = chartData(bounded, 0.02, null)!;
  expect(data.bound.filter((value) => value !== null)).toEqual([curve[0], curve[2], curve[3]].map((point) => 1.5 * point.error));
  expect(data.yRange[1]).toBeGreaterThan(1.5 * curve[0].error);
  expect(chartData(curve, null, null)!.bound.every((value) => value === null)).toBe(true);
  const say = { percent: (value: number) => `${value}`, duration: (seconds: number) => `${seconds} s` };
  expect(inWords([{ seconds: 2, spp: 8, error: 0.125, upper: 0.25 }], 0.1, say)).toBe(
    'The relative error is 0.125 after 2 s. The target is 0.1; the bound, which decides, is 0.25.',
  );
});

it('ticks are round and few', () => {
  expect(logTicks(0.015, 0.7, 10)).toEqual([0.02, 0.05, 0.1, 0.2, 0.5]);
  expect(logTicks(0.0015, 0.7, 5)).toEqual([0.003, 0.01, 0.03, 0.1, 0.3]);
  expect(timeTicks(0.4, 700, 20)).toEqual([0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600]);
  expect(timeTicks(0.4, 700, 5)).toHaveLength(5);
});

it('says the curve in one sentence', () => {
  const say = { percent: (value: number) => `${value}`, duration: (seconds: number) => `${seconds} s` };
  expect(inWords(curve.slice(0, 2), 0.02, say)).toBe(
    `The relative error fell from 0.2 after 1 s to ${curve[1].error} after 2 s. The target is 0.02.`,
  );
  expect(inWords([], null, say)).toBe('No error has been measured yet.');
});
