/** One pixel of a frame, read as value ± 95 % interval. */
import { ENOUGH_REPLICATES, t95 } from '../numbers/student';
import { type Frame, LUMA, relativeError } from './decode';
import { halfTable } from './half';

export interface Reading {
  red: number;
  green: number;
  blue: number;
  luminance: number;
  /** Standard error of the luminance; NaN where there is no estimate yet. */
  standardError: number;
  /** Half-width of the 95 % interval of the luminance: Student t with replicates − 1. NaN without estimate. */
  half: number;
  /** Standard error over the value, where the image's dark floor is in it: what counts in the image's error. */
  relative: number;
  /** Standard error over the value alone; infinite where that is 0. */
  ofValue: number;
  isValid: boolean;
  hasEstimate: boolean;
  /** Too few replicates for the interval to be more than a rough one. */
  isRough: boolean;
}

/** Reads image pixel (x, y). `replicates` of this very pixel, where known, else the frame's smallest number. */
export function readPixelOf(frame: Frame, x: number, y: number, replicates?: number): Reading {
  const { header, halves, summary } = frame;
  const column = Math.min(Math.floor(x / header.reduce), header.width - 1);
  const row = Math.min(Math.floor(y / header.reduce), header.height - 1);
  const at = 4 * (row * header.width + column);
  const value = halfTable();
  const [red, green, blue, error] = [0, 1, 2, 3].map((channel) => value[halves[at + channel]] / header.scale);
  const luminance = LUMA[0] * red + LUMA[1] * green + LUMA[2] * blue;
  const relative = relativeError(luminance, error, summary.meanLuminance);
  const hasEstimate = !Number.isNaN(relative);
  const n = Math.max(replicates ?? header.replicates_min, 2);
  return {
    red,
    green,
    blue,
    luminance,
    standardError: hasEstimate ? error : Number.NaN,
    half: hasEstimate ? error * t95(n - 1) : Number.NaN,
    relative,
    ofValue: hasEstimate ? error / Math.abs(luminance) : Number.NaN,
    isValid: Number.isFinite(luminance),
    hasEstimate,
    isRough: n < ENOUGH_REPLICATES,
  };
}

/** Replicates of image pixel (x, y) and whether its interval is trusted; null in a frame without maps. */
export function replicatesOf(frame: Frame, x: number, y: number): { replicates: number; isTrusted: boolean } | null {
  const { header, counts } = frame;
  if (!counts) return null;
  const column = Math.min(Math.floor(x / header.reduce), header.width - 1);
  const bits = counts[Math.min(Math.floor(y / header.reduce), header.height - 1) * header.width + column];
  return { replicates: halfTable()[bits & 0x7fff], isTrusted: (bits & 0x8000) === 0 };
}
