import { expect, it } from 'vitest';
import type { TradeSetting } from '../api/messages';
import { curvesOf, sideOf, trackOf } from './trade';

const setting = (more: Partial<TradeSetting>): TradeSetting => ({
  name: 'mis', group: 'default', technique: 'mis', curve: [{ seconds: 2, spp: 8, error: 0.1, low: 0.09, high: 0.12 }], seconds: 2,
  samples_per_second: 1, work: 0.02, work_low: 0.01, work_high: 0.04, times: 1, times_low: null, times_high: null, times_to: [],
  lost_light: 0, is_trusted: true, cannot_see: [], ...more,
}); // prettier-ignore

it('squares errors and their intervals', () => {
  const [curve] = curvesOf([setting({}), setting({ name: 'dark', curve: [] })]);
  expect(curve.points[0].y).toBeCloseTo(0.01);
  expect(curve.points[0].low).toBeCloseTo(0.0081);
  expect(curve.points[0].high).toBeCloseTo(0.0144);
  expect(curvesOf([setting({ curve: [] })])).toEqual([]);
});

it('says a ratio only where its interval leaves 1 out', () => {
  expect(sideOf(setting({ times: 3, times_low: 2, times_high: 4 }))).toBe('more');
  expect(sideOf(setting({ times: 0.5, times_low: 0.4, times_high: 0.6 }))).toBe('less');
  expect(sideOf(setting({ times: 1.2, times_low: 0.9, times_high: 1.5 }))).toBe('equal');
  expect(sideOf(setting({ times: 3 }))).toBeNull();
});

it('all ratios and 1 have places on the track', () => {
  const at = trackOf([setting({ times: 70, times_low: 40, times_high: 120 }), setting({ times: null })]);
  for (const ratio of [1, 40, 70, 120]) expect(at(ratio)).toBeGreaterThan(0);
  expect(at(120)).toBeLessThan(100);
  expect(at(70) - at(7)).toBeCloseTo(at(7) - at(0.7), 6);
});
