import { describe, expect, it } from 'vitest';
import { decodeFrame, FrameError, HISTOGRAM, relativeError, shareBelow } from './decode';
import { halfTable, halfToNumber, isNaNHalf } from './half';
import { readPixelOf } from './reading';
import { ONE, frameBody, INFINITE, NOT_A_NUMBER } from './sample';

describe('half floats', () => {
  it.each([
    [0x0000, 0], [0x3c00, 1], [0xc000, -2], [0x7bff, 65504], [0x0001, 2 ** -24], [0x03ff, 1023 * 2 ** -24], [0x3555, 0.333251953125],
  ])('pattern %i is %f', (bits, value) => {
    expect(halfToNumber(bits)).toBe(value);
    expect(halfTable()[bits]).toBe(value);
  }); // prettier-ignore

  it('knows infinity and NaN', () => {
    expect(halfToNumber(0x7c00)).toBe(Infinity);
    expect(halfToNumber(0xfc00)).toBe(-Infinity);
    expect(halfToNumber(0x7e00)).toBeNaN();
    expect(isNaNHalf(0x7e00)).toBe(true);
    expect(isNaNHalf(0x7c00)).toBe(false);
  });
});

describe('decodeFrame', () => {
  const body = frameBody({ width: 2, height: 2, scale: 2 }, [
    [ONE, ONE, ONE, 0x2e66], // Y = 0.5, SE = 0.05
    [0, 0, 0, 0],
    [ONE, ONE, ONE, INFINITE],
    [NOT_A_NUMBER, ONE, ONE, ONE],
  ]);
  const frame = decodeFrame(body);

  it('puts the byte planes together', () => {
    expect([...frame.halves.slice(0, 4)]).toEqual([ONE, ONE, ONE, 0x2e66]);
    expect(frame.header.width).toBe(2);
  });

  it('counts what has no estimate and what is invalid', () => {
    expect(frame.summary.invalid).toBe(1);
    expect(frame.summary.unknown).toBe(3);
    expect(frame.summary.meanLuminance).toBeCloseTo(1 / 3);
    expect(frame.summary.histogram.reduce((a, b) => a + b, 0)).toBe(1);
  });

  it('tells the share below a limit from the histogram', () => {
    expect(shareBelow(frame.summary, 0.2)).toBe(1);
    expect(shareBelow(frame.summary, 0.02)).toBe(0);
  });

  it('reads a pixel as value and 95 % interval', () => {
    const reading = readPixelOf(frame, 0, 0, 8);
    expect(reading.luminance).toBeCloseTo(0.5);
    expect(reading.standardError).toBeCloseTo(0.05, 4);
    expect(reading.half / reading.standardError).toBeCloseTo(2.36462, 4);
    expect(reading.isRough).toBe(false);
    expect(readPixelOf(frame, 0, 0, 7).isRough).toBe(true);
  });

  it('never calls "nothing found, no spread" perfect', () => {
    expect(readPixelOf(frame, 1, 0).hasEstimate).toBe(false);
    expect(readPixelOf(frame, 0, 1).hasEstimate).toBe(false);
    expect(readPixelOf(frame, 1, 1).isValid).toBe(false);
  });

  it('maps image pixels to the texels of a 2×2 mean', () => {
    const small = decodeFrame(frameBody({ width: 2, height: 1, reduce: 2 }, [[ONE, ONE, ONE, 0], [0, 0, 0, 0]])); // prettier-ignore
    expect(readPixelOf(small, 1, 1).luminance).toBeCloseTo(1);
    expect(readPixelOf(small, 3, 0).luminance).toBe(0);
  });

  it('refuses what is no frame, by name', () => {
    expect(() => decodeFrame(new ArrayBuffer(16))).toThrow(FrameError);
    expect(() => decodeFrame(body.slice(0, body.byteLength - 1))).toThrow(/expected for 2×2/);
    expect(() => decodeFrame(frameBody({ layout: 'other' }, [[0, 0, 0, 0]]))).toThrow(/layout other/);
  });
});

it('a reading tells the relative error with the dark floor and without', () => {
  const dark = decodeFrame(frameBody({ width: 2, height: 1 }, [[0x2000, 0x2000, 0x2000, 0x1800], [ONE, ONE, ONE, ONE]])); // prettier-ignore
  const reading = readPixelOf(dark, 0, 0); // Y = 2⁻⁷, SE = 2⁻⁹, mean 0.504
  expect(reading.ofValue).toBeCloseTo(0.25, 3);
  expect(reading.relative).toBeCloseTo(2 ** -9 / Math.hypot(2 ** -7, 0.0504), 3);
});

it('the relative error of a dark pixel is floored at a tenth of the mean', () => {
  expect(relativeError(0.001, 0.001, 1)).toBeCloseTo(0.01, 3);
  expect(relativeError(1, 0.05, 0.1)).toBeCloseTo(0.05, 3);
  expect(HISTOGRAM.bins % (HISTOGRAM.high - HISTOGRAM.low)).toBe(0);
});
