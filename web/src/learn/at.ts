/** Reads a direction from maps, and says numbers with what is known of them. Pure. */
import type { Frame } from '../frame/decode';
import { halfTable } from '../frame/half';
import { radiance, withError } from '../numbers/format';
import { t95 } from '../numbers/student';
import { half95, type Step, variance } from './moments';

/** Luminance of a cell, and the half-width of its 95 % interval. */
export interface Reading {
  value: number;
  half: number;
}

export function readingAt(map: Frame, u: number, v: number): Reading {
  const { width, height, scale } = map.header;
  const cell = Math.min(Math.floor(v * height), height - 1) * width + Math.min(Math.floor(u * width), width - 1);
  const table = halfTable();
  const [r, g, b, error] = [0, 1, 2, 3].map((channel) => table[map.halves[4 * cell + channel]] / scale);
  return { value: 0.2126 * r + 0.7152 * g + 0.0722 * b, half: error * t95(Math.max(map.header.seq - 1, 1)) };
}

/** The brightest cell's middle; the middle of the map where all is dark. */
export function brightestOf(map: Frame): { u: number; v: number } {
  const { width, height } = map.header;
  let best = { u: 0.5, v: 0.5 };
  let most = 0;
  for (let row = 0; row < height; row++)
    for (let column = 0; column < width; column++) {
      const at = { u: (column + 0.5) / width, v: (row + 0.5) / height };
      const { value } = readingAt(map, at.u, at.v);
      if (value > most) [most, best] = [value, at];
    }
  return best;
}

/** Solid angle of the cell of a map that holds v. */
export function solidAngle(map: Frame, v: number, polarRange: number): number {
  const { width, height } = map.header;
  const row = Math.min(Math.floor(v * height), height - 1);
  const [top, bottom] = [row, row + 1].map((edge) => Math.cos((edge / height) * polarRange));
  return ((2 * Math.PI) / width) * (top - bottom);
}

export const said = ({ value, half }: Reading): string => (half > 0 ? withError(value, half).join(' ± ') : radiance(value));

/** A mean with its interval: exact where all samples are equal. */
export const saidStep = (step: Step): string => (variance(step) > 0 ? withError(step.mean, half95(step)).join(' ± ') : radiance(step.mean));
