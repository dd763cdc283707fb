/** How far two frames of the same picture agree within their error bars. */
import type { Agreement } from '../viewer/scene';
import { type Frame, LUMA } from './decode';
import { halfTable } from './half';
import { atReduction } from './reduce';

/** Beyond this many standard errors lie 5 % of a normal variable. */
const APART = 1.96;

/** Over pixels with an estimate in both, at the coarser one's resolution; null where the sizes differ or no pixel has one. */
export function agreement(one: Frame, another: Frame): Agreement | null {
  const reduce = Math.max(one.header.reduce, another.header.reduce);
  const [a, b] = [atReduction(one, reduce), atReduction(another, reduce)];
  if (b.header.width !== a.header.width || b.header.height !== a.header.height) return null;
  const value = halfTable();
  const [scaleA, scaleB] = [a.header.scale, b.header.scale];
  const luminance = ({ halves }: Frame, at: number): number =>
    LUMA[0] * value[halves[at]] + LUMA[1] * value[halves[at + 1]] + LUMA[2] * value[halves[at + 2]];
  let pixels = 0;
  let apart = 0;
  let sum = 0;
  for (let at = 0; at < a.halves.length; at += 4) {
    const variance = (value[a.halves[at + 3]] / scaleA) ** 2 + (value[b.halves[at + 3]] / scaleB) ** 2;
    const gap = luminance(a, at) / scaleA - luminance(b, at) / scaleB;
    if (!(variance > 0) || !Number.isFinite(variance) || !Number.isFinite(gap)) continue;
    const square = (gap * gap) / variance;
    pixels++;
    sum += square;
    if (square > APART * APART) apart++;
  }
  return pixels > 0 ? { pixels, apart: apart / pixels, rms: Math.sqrt(sum / pixels) } : null;
}
