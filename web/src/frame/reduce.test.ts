import { expect, it } from 'vitest';
import { agreement } from './agreement';
import { decodeFrame } from './decode';
import { halfToNumber, toHalf } from './half';
import { readPixelOf, replicatesOf } from './reading';
import { atReduction } from './reduce';
import { frameBody, INFINITE, NOT_A_NUMBER, ONE } from './sample';

const TWO = 0x4000;
const frame = (pixels: number[][], width: number, height: number, header = {}) =>
  decodeFrame(frameBody({ width, height, ...header }, pixels));

it('every half survives being written again, and numbers are rounded to the nearest', () => {
  for (let bits = 0; bits < 0x7c00; bits += 7) expect(toHalf(halfToNumber(bits))).toBe(bits);
  expect(toHalf(-2)).toBe(0xc000);
  expect(toHalf(1 + 1 / 2048 + 1e-6)).toBe(0x3c01);
  expect(toHalf(65504)).toBe(0x7bff);
  expect(toHalf(Infinity)).toBe(INFINITE);
  expect(halfToNumber(toHalf(Number.NaN))).toBeNaN();
});

it('2×2 means have the mean of the values and √ΣSE²/4 as their error, odd edges those of what is there', () => {
  const small = atReduction(frame([[ONE, ONE, ONE, ONE], [TWO, TWO, TWO, ONE], [ONE, ONE, ONE, ONE]], 3, 1), 2); // prettier-ignore
  expect(small.header).toMatchObject({ width: 2, height: 1, reduce: 2 });
  expect(readPixelOf(small, 0, 0).luminance).toBeCloseTo(1.5, 2);
  expect(readPixelOf(small, 0, 0).standardError).toBeCloseTo(Math.SQRT2 / 2, 2);
  expect(readPixelOf(small, 2, 0).standardError).toBe(1);
});

it('one pixel without an estimate, a trust or a number leaves the four without', () => {
  const pixels = [[ONE, ONE, ONE, ONE, 0x4900], [ONE, ONE, ONE, INFINITE, 0xc400]]; // 10 trusted, 4 not
  const small = atReduction(frame(pixels, 2, 1), 2);
  expect(readPixelOf(small, 0, 0).hasEstimate).toBe(false);
  expect(replicatesOf(small, 0, 0)).toEqual({ replicates: 4, isTrusted: false });
  expect(readPixelOf(atReduction(frame([[NOT_A_NUMBER, ONE, ONE, ONE], [ONE, ONE, ONE, ONE]], 2, 1), 2), 0, 0).isValid).toBe(false); // prettier-ignore
});

it('two frames of one picture agree whatever the link did to one of them', () => {
  const pixels = Array.from({ length: 16 }, (_, i) => [i % 2 ? ONE : TWO, ONE, ONE, 0x2e66]);
  const whole = frame(pixels, 4, 4);
  const small = atReduction(whole, 2);
  expect(atReduction(small, 1)).toBe(small);
  expect(agreement(whole, small)).toMatchObject({ pixels: 4, apart: 0, rms: 0 });
  expect(agreement(small, whole)).toMatchObject({ pixels: 4, rms: 0 });
});
