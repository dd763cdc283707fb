import { expect, it } from 'vitest';
import { bytes, count, duration, ordinal, percent, radiance, roughDuration, roundPercent, tickDuration, when, withError } from './format';

const spaced = (text: string): string => text.replace(/[\u202f\u00a0]/g, ' ');

it('a percentage keeps its significant digits', () => {
  expect(spaced(percent(0.0315, 3))).toBe('3.15 %');
  expect(spaced(percent(0.02))).toBe('2.0 %');
  expect(spaced(percent(0.00042))).toBe('0.042 %');
  expect(spaced(percent(1))).toBe('100 %');
  expect(percent(null)).toBe('–');
  expect(spaced(roundPercent(0.02))).toBe('2 %');
});

it('durations are said as people say them', () => {
  expect([0.42, 3.24, 42, 112, 3600, 7500, 200_000].map((s) => spaced(duration(s)))).toEqual([
    '0.4 s', '3.2 s', '42 s', '1 min 52 s', '1 h', '2 h 5 min', '2 d 8 h',
  ]); // prettier-ignore
  expect([0.3, 3.2, 43, 80, 7000].map((s) => spaced(roughDuration(s)))).toEqual(['under 1 s', '3 s', '45 s', '1 min', '1.9 h']);
  expect([0.5, 120, 7200].map((s) => spaced(tickDuration(s)))).toEqual(['0.5 s', '2 min', '2 h']);
});

it('ordinals know eleven to thirteen', () => {
  expect([1, 2, 3, 4, 11, 12, 13, 21, 102, 111].map(ordinal).join(' ')).toBe('1st 2nd 3rd 4th 11th 12th 13th 21st 102nd 111th');
});

it('a value is rounded where its error is', () => {
  expect(withError(0.24561, 0.01346)).toEqual(['0.246', '0.013']);
  expect(withError(12.3456, 1.4)).toEqual(['12.3', '1.4']);
  expect(withError(345.6, 21)).toEqual(['346', '21']);
  expect(withError(0.5, Number.NaN)).toEqual(['0.5000', '?']);
});

it('radiance shows what is no number', () => {
  expect(radiance(null)).toBe('NaN');
  expect(radiance(Number.NaN)).toBe('NaN');
  expect(radiance(Infinity)).toBe('∞');
  expect(radiance(0.09015)).toBe('0.09015');
  expect(radiance(2.5e-7)).toBe('2.500e−7');
});

it('counts and sizes carry a prefix', () => {
  expect([0.5, 8, 999, 12_345, 23_500_000, 4.2e9].map((n) => spaced(count(n)))).toEqual(['0.5', '8', '999', '12.3 k', '23.5 M', '4.20 G']);
  expect([12, 4500, 7_400_000].map((n) => spaced(bytes(n)))).toEqual(['12 B', '4.50 kB', '7.40 MB']);
});

it('a time is told by the hour today, by the day before, and by the year where it is another', () => {
  const now = new Date(2026, 11, 1, 14, 30);
  expect(when(new Date(2026, 11, 1, 9, 5), now, 'en-GB')).toBe('09:05');
  expect(when(new Date(2026, 10, 30, 23, 59), now, 'en-GB')).toBe('30 Nov');
  expect(when(new Date(2025, 11, 1, 14, 30), now, 'en-GB')).toBe('1 Dec 2025');
  expect(when(new Date('no date'), now)).toBe('–');
});
