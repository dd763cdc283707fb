/** A frame as 2×2 means, as the service makes them for a slow link: two frames are only compared at one resolution. */
import { type Frame, summarise } from './decode';
import { halfTable, toHalf } from './half';

const SMALLEST = 1; // the pattern of the smallest positive half

/** The frame in pixels of at least `reduce` × `reduce`: itself where it already is. */
export function atReduction(frame: Frame, reduce: number): Frame {
  return frame.header.reduce >= reduce ? frame : halved(frame);
}

function halved({ header, halves, counts }: Frame): Frame {
  const value = halfTable();
  const width = Math.ceil(header.width / 2);
  const height = Math.ceil(header.height / 2);
  const small = new Uint16Array(4 * width * height);
  const smallCounts = counts && new Uint16Array(width * height);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const four = pixelsUnder(column, row, header.width, header.height);
      const at = row * width + column;
      for (let channel = 0; channel < 3; channel++)
        small[4 * at + channel] = toHalf(four.reduce((sum, pixel) => sum + value[halves[4 * pixel + channel]], 0) / four.length);
      // Of independent pixels; infinite, no estimate, where one has none.
      const error = Math.sqrt(four.reduce((sum, pixel) => sum + value[halves[4 * pixel + 3]] ** 2, 0)) / four.length;
      small[4 * at + 3] = error > 0 ? Math.max(toHalf(error), SMALLEST) : toHalf(error);
      if (counts && smallCounts) smallCounts[at] = fewest(four.map((pixel) => counts[pixel]));
    }
  }
  return {
    header: { ...header, width, height, reduce: 2 * header.reduce },
    halves: small,
    counts: smallCounts,
    summary: summarise(small, header.scale, width),
  };
}

/** One to four, at the edges of an odd picture. */
function pixelsUnder(column: number, row: number, width: number, height: number): number[] {
  const found: number[] = [];
  for (let y = 2 * row; y < Math.min(2 * row + 2, height); y++) {
    for (let x = 2 * column; x < Math.min(2 * column + 2, width); x++) found.push(y * width + x);
  }
  return found;
}

/** The fewest replicates, trusted only where all are: the sign bit says "not". */
const fewest = (bits: readonly number[]): number =>
  Math.min(...bits.map((one) => one & 0x7fff)) | (bits.some((one) => one & 0x8000) ? 0x8000 : 0);
