/**
 * EXR's PIZ compression, Mitsuba's default: 16-bit words through a table of those that occur, a two-dimensional Haar wavelet in whole
 * numbers, and Huffman codes (openexr.com, "Technical Introduction", and the layout of its library's ImfPizCompressor, ImfWav, ImfHuf).
 */
import { bytesOf, type Channel } from './exr';
import { FileError } from './raster';

const WORDS = 1 << 16;
const SYMBOLS = WORDS + 1;
const LONGEST = 58;
/** Codes up to here are found by one look-up. */
const QUICK = 13;

export function unpackPiz(packed: Uint8Array, channels: readonly Channel[], width: number, height: number): Uint8Array {
  const view = new DataView(packed.buffer, packed.byteOffset, packed.byteLength);
  const [low, high] = [view.getUint16(0, true), view.getUint16(2, true)];
  const bitmap = new Uint8Array(WORDS / 8);
  let at = 4;
  if (low <= high) {
    bitmap.set(packed.subarray(at, at + high - low + 1), low);
    at += high - low + 1;
  }
  const { table, largest } = wordsOf(bitmap);
  const length = view.getInt32(at, true);
  at += 4;
  const wide = channels.map(({ type }) => bytesOf(type) / 2);
  const total = wide.reduce((sum, words) => sum + words, 0) * width * height;
  const words = decodeHuffman(packed.subarray(at, at + length), total);
  let start = 0;
  const starts = wide.map((size) => {
    const begin = start;
    for (let j = 0; j < size; j++) undoWavelet(words, begin + j, width, size, height, width * size, largest);
    start += width * height * size;
    return begin;
  });
  for (let i = 0; i < total; i++) words[i] = table[words[i]];
  const lines = new Uint16Array(total);
  let out = 0;
  for (let y = 0; y < height; y++) {
    wide.forEach((size, index) => {
      const from = starts[index] + y * width * size;
      lines.set(words.subarray(from, from + width * size), out);
      out += width * size;
    });
  }
  return new Uint8Array(lines.buffer);
}

/** The words that occur, 0 among them always, by their rank. */
function wordsOf(bitmap: Uint8Array): { table: Uint16Array; largest: number } {
  const table = new Uint16Array(WORDS);
  let count = 0;
  for (let word = 0; word < WORDS; word++) if (word === 0 || bitmap[word >> 3] & (1 << (word & 7))) table[count++] = word;
  return { table, largest: count - 1 };
}

function undoWavelet(a: Uint16Array, start: number, nx: number, ox: number, ny: number, oy: number, largest: number): void {
  const isSmall = largest < 1 << 14;
  let [first, second] = [0, 0];
  const pair = (low: number, high: number): void => {
    if (isSmall) {
      const [l, h] = [(low << 16) >> 16, (high << 16) >> 16];
      first = l + (h & 1) + (h >> 1);
      second = first - h;
    } else {
      second = (low - (high >> 1)) & 0xffff;
      first = (high + second - 0x8000) & 0xffff;
    }
  };
  let p = 1;
  while (p <= Math.min(nx, ny)) p <<= 1;
  p >>= 1;
  let p2 = p;
  for (p >>= 1; p >= 1; p2 = p, p >>= 1) {
    let y = 0;
    for (; y <= ny - p2; y += p2) {
      let x = 0;
      for (; x <= nx - p2; x += p2) {
        const i00 = start + y * oy + x * ox;
        const [i01, i10] = [i00 + p * ox, i00 + p * oy];
        const i11 = i10 + p * ox;
        pair(a[i00], a[i10]);
        const [v00, v10] = [first & 0xffff, second & 0xffff];
        pair(a[i01], a[i11]);
        const [v01, v11] = [first & 0xffff, second & 0xffff];
        pair(v00, v01);
        a[i00] = first;
        a[i01] = second;
        pair(v10, v11);
        a[i10] = first;
        a[i11] = second;
      }
      if (nx & p) {
        const i00 = start + y * oy + x * ox;
        pair(a[i00], a[i00 + p * oy]);
        a[i00] = first;
        a[i00 + p * oy] = second;
      }
    }
    if (ny & p) {
      for (let x = 0; x <= nx - p2; x += p2) {
        const i00 = start + y * oy + x * ox;
        pair(a[i00], a[i00 + p * ox]);
        a[i00] = first;
        a[i00 + p * ox] = second;
      }
    }
  }
}

/** Bits from the most significant on; beyond the end they are 0. */
class Bits {
  private held = 0;
  private count = 0;
  at = 0;

  constructor(private readonly bytes: Uint8Array) {}

  /** The next n bits, n up to 16, which stay. */
  look(n: number): number {
    while (this.count < n) {
      this.held = (this.held << 8) | (this.bytes[this.at++] ?? 0);
      this.count += 8;
    }
    return this.held >>> (this.count - n);
  }

  take(n: number): number {
    const value = this.look(n);
    this.count -= n;
    this.held &= (1 << this.count) - 1;
    return value;
  }
}

function decodeHuffman(packed: Uint8Array, total: number): Uint16Array<ArrayBuffer> {
  const words = new Uint16Array(total);
  if (packed.length < 20) {
    if (total > 0 && packed.length > 0) throw new FileError('a PIZ block of this EXR file is damaged');
    return words;
  }
  const view = new DataView(packed.buffer, packed.byteOffset, packed.byteLength);
  const [lowest, run] = [view.getUint32(0, true), view.getUint32(4, true)];
  if (lowest >= SYMBOLS || run >= SYMBOLS) throw new FileError('a PIZ block of this EXR file is damaged');
  const bits = new Bits(packed.subarray(20));
  const lengths = readLengths(bits, lowest, run);
  const codes = codesOf(lengths);
  const data = new Bits(packed.subarray(20 + bits.at));
  let out = 0;
  while (out < total) {
    const symbol = nextSymbol(data, codes);
    if (symbol !== run) {
      words[out++] = symbol;
      continue;
    }
    const repeats = data.take(8);
    if (out === 0 || out + repeats > total) throw new FileError('a PIZ block of this EXR file is damaged');
    words.fill(words[out - 1], out, out + repeats);
    out += repeats;
  }
  return words;
}

/** Code lengths of the symbols from `lowest` to `highest`, zeros in runs. */
function readLengths(bits: Bits, lowest: number, highest: number): Uint8Array {
  const lengths = new Uint8Array(SYMBOLS);
  for (let symbol = lowest; symbol <= highest; ) {
    const length = bits.take(6);
    if (length === 63) symbol += bits.take(8) + 6;
    else if (length >= 59) symbol += length - 59 + 2;
    else lengths[symbol++] = length;
  }
  return lengths;
}

interface Codes {
  /** Symbol · 64 + length by the next QUICK bits; 0 where the code is longer. */
  quick: Uint32Array;
  /** By length: the smallest code, and where its symbols begin in `symbols`. */
  first: Float64Array;
  count: Uint32Array;
  begin: Uint32Array;
  symbols: Uint32Array;
}

/** Canonical codes: long ones are the smaller numbers; of one length in the order of the symbols. */
function codesOf(lengths: Uint8Array): Codes {
  const count = new Uint32Array(LONGEST + 1);
  for (const length of lengths) if (length > 0) count[length]++;
  const first = new Float64Array(LONGEST + 1);
  for (let length = LONGEST, code = 0; length > 0; length--) {
    first[length] = code;
    code = Math.floor((code + count[length]) / 2);
  }
  const begin = new Uint32Array(LONGEST + 2);
  for (let length = 1; length <= LONGEST; length++) begin[length + 1] = begin[length] + count[length];
  const symbols = new Uint32Array(begin[LONGEST + 1]);
  const filled = begin.slice();
  const quick = new Uint32Array(1 << QUICK);
  lengths.forEach((length, symbol) => {
    if (length === 0) return;
    const rank = filled[length]++;
    symbols[rank] = symbol;
    if (length > QUICK) return;
    const code = first[length] + rank - begin[length];
    const spare = QUICK - length;
    quick.fill(symbol * 64 + length, code * 2 ** spare, (code + 1) * 2 ** spare);
  });
  return { quick, first, count, begin, symbols };
}

function nextSymbol(bits: Bits, { quick, first, count, begin, symbols }: Codes): number {
  const found = quick[bits.look(QUICK)];
  if (found > 0) {
    bits.take(found & 63);
    return found >>> 6;
  }
  let code = bits.take(QUICK);
  for (let length = QUICK + 1; length <= LONGEST; length++) {
    code = code * 2 + bits.take(1);
    const rank = code - first[length];
    if (rank >= 0 && rank < count[length]) return symbols[begin[length] + rank];
  }
  throw new FileError('a PIZ block of this EXR file is damaged');
}
