/** A rectangle of a picture in numbers: each channel's mean with its interval, extremes, and how much of it is trusted. */
import type { Region } from '../api/types';
import { t95 } from '../numbers/student';
import { layersOf, type Raster, threeOf } from './raster';

export interface ChannelRegion {
  name: string;
  mean: number;
  min: number;
  max: number;
  /**
   * Half-width of the mean's 95 % interval; null where it is not known: a pixel has no standard error. Where pixels share samples, and
   * their errors are alike to an unknown degree, the most that it can be.
   */
  half: number | null;
  /** The mean's standard error, on the same terms. */
  standardError: number | null;
}

export interface RegionNumbers {
  pixels: number;
  /** Pixels that are not a number, left out of all. */
  invalid: number;
  channels: ChannelRegion[];
  /** Null where the file does not tell. */
  shareTrusted: number | null;
  /** False: `half` is an upper bound. */
  isIndependent: boolean;
}

export function numbersIn(raster: Raster, [left, top, width, height]: Region): RegionNumbers {
  const isIndependent = hasIndependentPixels(raster);
  const at: number[] = [];
  for (let y = top; y < Math.min(top + height, raster.height); y++) for (let x = left; x < Math.min(left + width, raster.width); x++) at.push(y * raster.width + x);
  const main = layersOf(raster.planes.keys())[0];
  const planes = main.channels.length >= 3 ? threeOf(raster, main) : main.channels.map((name) => raster.planes.get(name)!);
  const valid = at.filter((i) => planes.every((plane) => Number.isFinite(plane[i])));
  const counts = raster.planes.get('count') ?? null;
  const trust = raster.planes.get('trust') ?? null;
  const channel = (name: string, value: (i: number) => number, error: Float32Array | null): ChannelRegion => {
    let [sum, min, max] = [0, Infinity, -Infinity];
    for (const i of valid) {
      const v = value(i);
      sum += v;
      min = Math.min(min, v);
      max = Math.max(max, v);
    }
    return { name, mean: sum / valid.length, min, max, ...spreadOf(valid, error, counts, isIndependent) };
  };
  const errorOf = (name: string): Float32Array | null => raster.planes.get(`stderr.${name}`) ?? null;
  const channels = planes.map((plane, c) => channel(main.channels[c], (i) => plane[i], errorOf(main.channels[c])));
  const [r, g, b] = planes;
  // Channels are correlated: luminance has an error of its own.
  if (planes.length === 3) channels.push(channel('Y', (i) => 0.2126 * r[i] + 0.7152 * g[i] + 0.0722 * b[i], errorOf('Y')));
  return {
    pixels: at.length,
    invalid: at.length - valid.length,
    channels,
    shareTrusted: trust && at.length > 0 ? at.filter((i) => trust[i] > 0).length / at.length : null,
    isIndependent,
  };
}

/** Whether a picture says that no sample counts in two of its pixels: ours do, in their settings; of others it is not known. */
export function hasIndependentPixels({ attributes }: Pick<Raster, 'attributes'>): boolean {
  const said = attributes['fredholm:settings'];
  if (said === undefined) return false;
  try {
    // Left out is the usual: independent.
    return (JSON.parse(String(said)) as { independent_pixels?: boolean }).independent_pixels !== false;
  } catch {
    return false;
  }
}

type Spread = Pick<ChannelRegion, 'half' | 'standardError'>;

/** Of a mean over pixels. Student's t with Welch's and Satterthwaite's degrees of freedom; the bound adds the pixels' own half-widths. */
function spreadOf(at: readonly number[], error: Float32Array | null, counts: Float32Array | null, isIndependent: boolean): Spread {
  const unknown = { half: null, standardError: null };
  if (!error || !counts || at.length === 0) return unknown;
  let [variance, squares, sum, halves] = [0, 0, 0, 0];
  for (const i of at) {
    const freedom = counts[i] - 1;
    if (!Number.isFinite(error[i]) || freedom < 1) return unknown;
    const v = error[i] ** 2;
    variance += v;
    squares += (v * v) / freedom;
    sum += error[i];
    halves += error[i] * t95(freedom);
  }
  // No spread at all is "no estimate", not "perfect".
  if (sum === 0) return unknown;
  if (!isIndependent) return { standardError: sum / at.length, half: halves / at.length };
  const standardError = Math.sqrt(variance) / at.length;
  return { standardError, half: standardError * t95(Math.max(Math.floor((variance * variance) / squares), 1)) };
}

/** A − B in standard errors of luminance; null where one is not known, or only bounded. */
export function zBetween(a: RegionNumbers, b: RegionNumbers): number | null {
  const [one, other] = [a, b].map(({ channels }) => channels[channels.length - 1]);
  if (!a.isIndependent || !b.isIndependent || one.standardError === null || other.standardError === null) return null;
  return (one.mean - other.mean) / Math.hypot(one.standardError, other.standardError);
}
