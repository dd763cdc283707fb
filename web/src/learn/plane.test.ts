import { expect, it } from 'vitest';
import { pathOf, rangeOf, ticks, tickSaid } from './plane';

it('ticks are round and lie within', () => {
  expect(ticks(0, Math.PI, 4)).toEqual([0, 1, 2, 3]);
  expect(ticks(-0.25, 0.25, 5)).toEqual([-0.2, -0.1, 0, 0.1, 0.2]);
  expect(ticks(1, 1, 5)).toEqual([]);
});

it('a range has zero in it, and what is unknown does not count', () => {
  expect(rangeOf([1, null, 3])).toEqual([0, 3]);
  expect(rangeOf([-2])).toEqual([-2, 0]);
  expect(rangeOf([0, null])).toEqual([0, 1]);
});

it('a line breaks where nothing is known', () => {
  const same = { x: (value: number) => value, y: (value: number) => value };
  expect(pathOf([0, 1, 2, 3], [0, 1, null, 3], same)).toBe('M0.0 0.0L1.0 1.0M3.0 3.0');
});

it('numbers of ticks are short', () => {
  expect([0, 0.5, -2, 1e6, 1e-4].map(tickSaid)).toEqual(['0', '0.5', '−2', '1e+6', '1e−4'.replace('−', '-').replace('-', '−')]);
});
