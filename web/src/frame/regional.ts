/** The image error of a part of a frame, as the service counts it: here over luminance alone. */
import type { Region } from '../api/types';
import { type Frame, LUMA, relativeError } from './decode';
import { halfTable } from './half';

/** Root mean square of the pixels' relative errors; null where no pixel of the region has an estimate. */
export function errorWithin({ header, halves, summary }: Frame, [x, y, width, height]: Region): number | null {
  const value = halfTable();
  const { reduce, scale } = header;
  const right = Math.min(Math.ceil((x + width) / reduce), header.width);
  const bottom = Math.min(Math.ceil((y + height) / reduce), header.height);
  let sum = 0;
  let pixels = 0;
  for (let row = Math.floor(y / reduce); row < bottom; row++) {
    for (let column = Math.floor(x / reduce); column < right; column++) {
      const at = 4 * (row * header.width + column);
      const luminance = LUMA[0] * value[halves[at]] + LUMA[1] * value[halves[at + 1]] + LUMA[2] * value[halves[at + 2]];
      const relative = relativeError(luminance / scale, value[halves[at + 3]] / scale, summary.meanLuminance);
      if (Number.isNaN(relative)) continue;
      sum += relative * relative;
      pixels++;
    }
  }
  return pixels > 0 ? Math.sqrt(sum / pixels) : null;
}
