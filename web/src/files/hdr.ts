/** Radiance pictures (.hdr): shared exponents, in runs or flat (Ward, "Real Pixels", Graphics Gems II). */
import { FileError, MOST_VALUES, type Raster } from './raster';

export const isHdr = (file: ArrayBuffer): boolean => {
  const [first, second] = new Uint8Array(file, 0, Math.min(2, file.byteLength));
  return first === 0x23 && second === 0x3f; // "#?"
};

/** Raises FileError. */
export function readHdr(file: ArrayBuffer): Raster {
  const bytes = new Uint8Array(file);
  const { at, lines } = headOf(bytes);
  const size = lines.pop()?.match(/^([-+])Y (\d+) \+X (\d+)$/);
  if (!size) throw new FileError('this .hdr file has no line "-Y height +X width" that can be read here');
  const format = lines.find((line) => line.startsWith('FORMAT='))?.slice(7) ?? '32-bit_rle_rgbe';
  if (format !== '32-bit_rle_rgbe') throw new FileError(`.hdr files of the format ${format} are not read here; save it as 32-bit_rle_rgbe`);
  const [height, width] = [Number(size[2]), Number(size[3])];
  if (!(width > 0 && height > 0) || 3 * width * height > MOST_VALUES) throw new FileError(`${width} × ${height} pixels do not fit here`);
  const exposure = lines.filter((line) => line.startsWith('EXPOSURE=')).reduce((product, line) => product * (Number(line.slice(9)) || 1), 1);
  const planes = [0, 1, 2].map(() => new Float32Array(width * height));
  const line = new Uint8Array(4 * width);
  let next = at;
  for (let row = 0; row < height; row++) {
    next = readLine(bytes, next, line, width);
    const start = (size[1] === '-' ? row : height - 1 - row) * width;
    for (let x = 0; x < width; x++) {
      const exponent = line[3 * width + x];
      const unit = exponent === 0 ? 0 : 2 ** (exponent - 136) / exposure;
      for (let c = 0; c < 3; c++) planes[c][start + x] = line[c * width + x] * unit;
    }
  }
  return { width, height, planes: new Map(['R', 'G', 'B'].map((name, c) => [name, planes[c]])), attributes: {} };
}

/** The header's lines with the size last, and where the pixels begin. */
function headOf(bytes: Uint8Array): { at: number; lines: string[] } {
  const lines: string[] = [];
  let at = 0;
  while (at < Math.min(bytes.length, 65536)) {
    const end = bytes.indexOf(10, at);
    if (end < 0) break;
    const line = new TextDecoder().decode(bytes.subarray(at, end)).trim();
    at = end + 1;
    lines.push(line);
    if (/^[-+][XY] /.test(line)) break;
  }
  return { at, lines };
}

/** One line as four planes; returns where the next one begins. */
function readLine(bytes: Uint8Array, at: number, line: Uint8Array, width: number): number {
  const isNew = width >= 8 && width < 32768 && bytes[at] === 2 && bytes[at + 1] === 2 && ((bytes[at + 2] << 8) | bytes[at + 3]) === width;
  return isNew ? readRuns(bytes, at + 4, line) : readOld(bytes, at, line, width);
}

function readRuns(bytes: Uint8Array, from: number, line: Uint8Array): number {
  let at = from;
  for (let out = 0; out < line.length; ) {
    const count = bytes[at++];
    const length = count > 128 ? count - 128 : count;
    if (at >= bytes.length || count === 0 || out + length > line.length) throw cutOff();
    if (count > 128) line.fill(bytes[at++], out, out + length);
    else {
      line.set(bytes.subarray(at, at + length), out);
      at += length;
    }
    out += length;
  }
  return at;
}

/** Flat pixels, where 1, 1, 1, n repeats the last one. */
function readOld(bytes: Uint8Array, from: number, line: Uint8Array, width: number): number {
  let at = from;
  let shift = 0;
  for (let x = 0; x < width; at += 4) {
    if (at + 4 > bytes.length) throw cutOff();
    const isRun = bytes[at] === 1 && bytes[at + 1] === 1 && bytes[at + 2] === 1 && x > 0;
    const repeats = isRun ? bytes[at + 3] << shift : 1;
    shift = isRun ? shift + 8 : 0;
    for (let i = 0; i < repeats && x < width; i++, x++)
      for (let c = 0; c < 4; c++) line[c * width + x] = isRun ? line[c * width + x - 1] : bytes[at + c];
  }
  return at;
}

const cutOff = (): FileError => new FileError('this .hdr file is cut off or damaged: it ends before the picture does');
