/** IEEE 754 half floats as 16-bit patterns. */

/** Value of one pattern. */
export function halfToNumber(bits: number): number {
  const sign = bits & 0x8000 ? -1 : 1;
  const exponent = (bits >> 10) & 0x1f;
  const fraction = bits & 0x3ff;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction === 0 ? sign * Infinity : Number.NaN;
  return sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}

let table: Float32Array | null = null;

/** All 65 536 values, made once: a look-up is several times faster than decoding. */
export function halfTable(): Float32Array {
  if (table) return table;
  table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) table[bits] = halfToNumber(bits);
  return table;
}

const float = new Float32Array(1);
const bitsOf = new Uint32Array(float.buffer);

/** The nearest pattern; numbers beyond the largest half become infinite. */
export function toHalf(value: number): number {
  float[0] = value;
  const sign = (bitsOf[0] >>> 16) & 0x8000;
  const magnitude = Math.abs(value);
  if (Number.isNaN(value)) return 0x7e00;
  if (magnitude >= 65520) return sign | 0x7c00;
  // Below the smallest normal half, steps are all of one size.
  if (magnitude < 2 ** -14) return sign | Math.round(magnitude * 2 ** 24);
  const bits = bitsOf[0] & 0x7fffffff;
  return sign | ((bits - 0x38000000 + 0xfff + ((bits >>> 13) & 1)) >>> 13);
}

export const isNaNHalf = (bits: number): boolean => (bits & 0x7c00) === 0x7c00 && (bits & 0x3ff) !== 0;
