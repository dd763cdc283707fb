/** What a picture's values reach, and how they are spread: of luminance, and of each channel. */
import type { Region } from '../api/types';
import { type Frame, LUMA } from './decode';
import { halfTable } from './half';

export interface Reach {
  /** Least and largest finite value of any channel. */
  whole: readonly [number, number];
  /** Of luminance, between which 98 % of the pixels lie. */
  usual: readonly [number, number];
}

const known = new WeakMap<Frame, Reach>();

export function valuesOf(frame: Frame): Reach {
  const found = known.get(frame) ?? reachOf(frame);
  known.set(frame, found);
  return found;
}

/** Sorting is dear: so many pixels stand for all. */
const SORTED = 1 << 16;

function reachOf({ header, halves }: Frame): Reach {
  const value = halfTable();
  let [low, high] = [Infinity, -Infinity];
  const luminance: number[] = [];
  const step = Math.max(1, Math.floor(halves.length / 4 / SORTED));
  for (let i = 0, at = 0; at < halves.length; i++, at += 4) {
    const [r, g, b] = [value[halves[at]], value[halves[at + 1]], value[halves[at + 2]]];
    const y = LUMA[0] * r + LUMA[1] * g + LUMA[2] * b;
    if (y - y !== 0) continue;
    low = Math.min(low, r, g, b);
    high = Math.max(high, r, g, b);
    if (i % step === 0) luminance.push(y);
  }
  if (luminance.length === 0) return { whole: [0, 1], usual: [0, 1] };
  luminance.sort((a, b) => a - b);
  const quantile = (share: number): number => luminance[Math.min(Math.floor(share * luminance.length), luminance.length - 1)] / header.scale;
  return { whole: [low / header.scale, high / header.scale], usual: [quantile(0.01), quantile(0.99)] };
}

/** Pixels by value on a logarithmic axis, a quarter of a stop a bin. */
export interface ValueHistogram {
  /** log2 of the left end of the first bin. */
  from: number;
  /** Of R, G, B. */
  counts: readonly [Uint32Array, Uint32Array, Uint32Array];
  /** Values that are 0 or negative, which such an axis has no place for. */
  unlit: number;
  pixels: number;
}

export const PER_STOP = 4;
const [LOW, STOPS] = [-24, 48];

/** Of the whole picture, or of a region in image pixels. */
export function histogramOf({ header, halves }: Frame, region: Region | null): ValueHistogram {
  const value = halfTable();
  const { reduce, scale, width, height } = header;
  const [x, y, w, h] = region ?? [0, 0, width * reduce, height * reduce];
  const counts = [0, 1, 2].map(() => new Uint32Array(STOPS * PER_STOP)) as unknown as ValueHistogram['counts'];
  const [right, bottom] = [Math.min(Math.ceil((x + w) / reduce), width), Math.min(Math.ceil((y + h) / reduce), height)];
  let [unlit, pixels] = [0, 0];
  for (let row = Math.floor(y / reduce); row < bottom; row++) {
    for (let column = Math.floor(x / reduce); column < right; column++, pixels++) {
      for (let c = 0; c < 3; c++) {
        const v = value[halves[4 * (row * width + column) + c]] / scale;
        if (!(v > 0)) unlit++;
        else if (v < Infinity) counts[c][Math.min(Math.max(Math.floor((Math.log2(v) - LOW) * PER_STOP), 0), STOPS * PER_STOP - 1)]++;
      }
    }
  }
  return { from: LOW, counts, unlit, pixels };
}
