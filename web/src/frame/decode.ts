/**
 * Frame bodies: 4-byte magic, u32 header length (little endian), JSON header, then the low bytes of R, G, B, SE
 * and the high bytes of R, G, B, SE, each width·height long, row 0 at the top. Values are half(value·scale).
 * A frame with maps has a fifth channel, N: replicates of the pixel, unscaled, negative where it is not trusted.
 */
import { halfTable } from './half';

export interface FrameHeader {
  seq: number;
  width: number;
  height: number;
  spp_min: number;
  spp_max: number;
  spp_mean: number;
  replicates_min: number;
  replicates_max: number;
  seconds: number;
  scale: number;
  /** 1, or 2 where each stored pixel is the mean of 2×2 image pixels. */
  reduce: number;
  layout: string;
  filled: boolean;
  channels: readonly string[];
  replicate_size: number;
}

/** What one pass over a frame tells: enough for the histogram, the exposure and the legend. */
export interface FrameSummary {
  meanLuminance: number;
  /** Luminance below which 99 % of the valid pixels lie. */
  whiteLuminance: number;
  /** Pixels per bin of log10(relative standard error), see HISTOGRAM; of large frames a part stands for all. */
  histogram: Uint32Array;
  /** Pixels without an error estimate. */
  unknown: number;
  /** Pixels with NaN or infinite radiance. */
  invalid: number;
}

export interface Frame {
  header: FrameHeader;
  /** (height, width, 4) half patterns of R, G, B and the standard error of luminance. */
  halves: Uint16Array<ArrayBuffer>;
  /** (height, width) half patterns of the replicates, negative where not trusted; null in a frame without maps. */
  counts: Uint16Array<ArrayBuffer> | null;
  summary: FrameSummary;
}

/** Relative errors from 0.001 % to 1000 % in 240 bins of log10. */
export const HISTOGRAM = { low: -5, high: 1, bins: 240 } as const;

/** Rec. 709 weights of luminance. */
export const LUMA = [0.2126, 0.7152, 0.0722] as const;

export class FrameError extends Error {}

export function decodeFrame(body: ArrayBuffer): Frame {
  const header = readHeader(body);
  const { halves, counts } = interleave(body, header);
  return { header, halves, counts, summary: summarise(halves, header.scale, header.width) };
}

export function readHeader(body: ArrayBuffer): FrameHeader {
  const view = new DataView(body);
  if (body.byteLength < 8 || view.getUint32(0, false) !== 0x46524431) throw new FrameError('not a frame: magic is not FRD1');
  const length = view.getUint32(4, true);
  if (8 + length > body.byteLength) throw new FrameError(`frame header of ${length} bytes exceeds the body`);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(body, 8, length))) as FrameHeader;
  if (header.layout !== 'byteplanes-half') throw new FrameError(`unknown frame layout ${header.layout}`);
  const planes = header.channels.length;
  if (planes !== 4 && planes !== 5) throw new FrameError(`frame with ${planes} channels, 4 or 5 expected`);
  const expected = 8 + length + header.width * header.height * 2 * planes;
  if (body.byteLength !== expected)
    throw new FrameError(`frame body has ${body.byteLength} bytes, ${expected} expected for ${header.width}×${header.height}`);
  return { ...header, reduce: header.reduce || 1 };
}

function interleave(body: ArrayBuffer, header: FrameHeader): Pick<Frame, 'halves' | 'counts'> {
  const start = 8 + new DataView(body).getUint32(4, true);
  const n = header.width * header.height;
  const planes = header.channels.length;
  const halves = new Uint16Array(4 * n);
  const counts = planes === 5 ? new Uint16Array(n) : null;
  for (let channel = 0; channel < planes; channel++) {
    const low = new Uint8Array(body, start + channel * n, n);
    const high = new Uint8Array(body, start + (planes + channel) * n, n);
    if (channel === 4) for (let i = 0; i < n; i++) counts![i] = low[i] | (high[i] << 8);
    else for (let i = 0, out = channel; i < n; i++, out += 4) halves[out] = low[i] | (high[i] << 8);
  }
  return { halves, counts };
}

/**
 * Relative error of one pixel as the service defines it: standard error over sqrt(Y² + (0.1·image mean)²), so that
 * dark pixels do not count for more than the eye sees. NaN where there is no estimate: SE infinite or NaN, or
 * both value and SE zero.
 */
export function relativeError(luminance: number, standardError: number, meanLuminance: number): number {
  if (!Number.isFinite(standardError) || !Number.isFinite(luminance)) return Number.NaN;
  if (standardError === 0 && luminance === 0) return Number.NaN;
  return standardError / Math.sqrt(luminance * luminance + 0.01 * meanLuminance * meanLuminance);
}

/** Logarithms are dear: of larger frames so many pixels, evenly spread, stand for all in the two histograms. */
const HISTOGRAM_PIXELS = 1 << 17;

export function summarise(halves: Uint16Array, scale: number, width = 1): FrameSummary {
  const value = halfTable();
  const n = halves.length / 4;
  const [red, green, blue] = LUMA.map((weight) => weight / scale);
  const luminance = new Float32Array(n);
  let sum = 0;
  let valid = 0;
  let unknown = 0;
  for (let i = 0, at = 0; i < n; i++, at += 4) {
    const y = red * value[halves[at]] + green * value[halves[at + 1]] + blue * value[halves[at + 2]];
    luminance[i] = y;
    // y − y is 0 for all but NaN and infinity, which have no estimate either.
    if (y - y !== 0) {
      unknown++;
      continue;
    }
    sum += y;
    valid++;
    const error = value[halves[at + 3]];
    if (error - error !== 0 || (error === 0 && y === 0)) unknown++;
  }
  const meanLuminance = valid > 0 ? sum / valid : 0;
  const bright = new Uint32Array(512); // log2 luminance, 8 bins a stop, −32 … +32
  const histogram = new Uint32Array(HISTOGRAM.bins);
  const perDecade = HISTOGRAM.bins / (HISTOGRAM.high - HISTOGRAM.low);
  const stride = strideOf(n, width);
  for (let i = 0; i < n; i += stride) {
    const y = luminance[i];
    if (y > 0 && y < Infinity) bright[clampBin((Math.log2(y) + 32) * 8, 512)]++;
    const relative = relativeError(y, value[halves[4 * i + 3]] / scale, meanLuminance);
    if (!Number.isNaN(relative)) histogram[clampBin((Math.log10(relative) - HISTOGRAM.low) * perDecade, HISTOGRAM.bins)]++;
  }
  return { meanLuminance, whiteLuminance: upperLuminance(bright), histogram, unknown, invalid: n - valid };
}

/** A step that visits about HISTOGRAM_PIXELS of n pixels, and not the same columns in every row. */
function strideOf(n: number, width: number): number {
  let stride = Math.max(1, Math.round(n / HISTOGRAM_PIXELS));
  while (stride > 1 && width % stride === 0) stride++;
  return stride;
}

/** Share of the pixels with an estimate whose relative error is below `limit`; null where none has one. */
export function shareBelow(summary: FrameSummary, limit: number): number | null {
  const edge = ((Math.log10(limit) - HISTOGRAM.low) * HISTOGRAM.bins) / (HISTOGRAM.high - HISTOGRAM.low);
  let below = 0;
  let total = 0;
  summary.histogram.forEach((pixels, bin) => {
    total += pixels;
    below += pixels * Math.min(Math.max(edge - bin, 0), 1);
  });
  return total > 0 ? below / total : null;
}

const clampBin = (position: number, bins: number): number => Math.min(Math.max(Math.floor(position), 0), bins - 1);

function upperLuminance(bright: Uint32Array): number {
  const total = bright.reduce((sum, pixels) => sum + pixels, 0);
  let seen = 0;
  for (let bin = 0; bin < bright.length; bin++) {
    seen += bright[bin];
    if (seen >= 0.99 * total && total > 0) return 2 ** ((bin + 1) / 8 - 32);
  }
  return 1;
}
