/** A layer of a file as a frame body, as the service would send it: one decoder, one painter for both. */
import type { FrameHeader } from '../frame/decode';
import { toHalf } from '../frame/half';
import { type Layer, type Raster, threeOf } from './raster';

/** Largest pattern that a half takes, with room to spare. */
const LARGEST = 32768;
const UNKNOWN = 0x7c00; // infinity: no estimate

/** Standard errors and counts go with the picture itself, where the file has them. */
export function bodyOf(raster: Raster, layer: Layer): ArrayBuffer {
  const { width, height, planes, attributes } = raster;
  const n = width * height;
  const colours = threeOf(raster, layer);
  const error = layer.name === '' ? planes.get('stderr.Y') : undefined;
  const counts = layer.name === '' ? planes.get('count') : undefined;
  const trust = planes.get('trust');
  const scale = scaleFor([...colours, ...(error ? [error] : [])]);
  const channels = counts ? (['R', 'G', 'B', 'SE', 'N'] as const) : (['R', 'G', 'B', 'SE'] as const);
  const [least, most] = counts ? extremes(counts) : [0, 0];
  const size = Number(attributes['fredholm:replicate_size'] ?? 1);
  const header: FrameHeader = {
    seq: 1, width, height, scale, reduce: 1, layout: 'byteplanes-half', filled: false, channels, replicate_size: size,
    replicates_min: least, replicates_max: most, spp_min: least * size, spp_max: most * size,
    spp_mean: Number(attributes['fredholm:spp'] ?? 0), seconds: Number(attributes['fredholm:seconds'] ?? 0),
  }; // prettier-ignore
  const head = padded(new TextEncoder().encode(JSON.stringify(header)));
  const body = new ArrayBuffer(8 + head.length + 2 * n * channels.length);
  const view = new DataView(body);
  view.setUint32(0, 0x46524431, false);
  view.setUint32(4, head.length, true);
  new Uint8Array(body, 8).set(head);
  const put = (plane: number, bitsOf: (i: number) => number): void => {
    const low = new Uint8Array(body, 8 + head.length + plane * n, n);
    const high = new Uint8Array(body, 8 + head.length + (channels.length + plane) * n, n);
    for (let i = 0; i < n; i++) {
      const bits = bitsOf(i);
      low[i] = bits & 0xff;
      high[i] = bits >> 8;
    }
  };
  colours.forEach((plane, c) => put(c, (i) => toHalf(plane[i] * scale)));
  put(3, (i) => (error ? toHalf(error[i] * scale) : UNKNOWN));
  if (counts) put(4, (i) => toHalf(counts[i]) | (trust && trust[i] > 0 ? 0 : 0x8000));
  return body;
}

function padded(head: Uint8Array): Uint8Array {
  const whole = new Uint8Array(Math.ceil(head.length / 8) * 8).fill(32);
  whole.set(head);
  return whole;
}

/** A power of two that brings the largest value near the largest half. */
function scaleFor(planes: readonly Float32Array[]): number {
  let largest = 0;
  for (const plane of planes) for (const value of plane) if (Math.abs(value) > largest && Math.abs(value) < Infinity) largest = Math.abs(value);
  return largest > 0 ? 2 ** Math.min(Math.max(Math.floor(Math.log2(LARGEST / largest)), -60), 60) : 1;
}

function extremes(values: Float32Array): [number, number] {
  let [least, most] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < least) least = value;
    if (value > most) most = value;
  }
  return [least, most];
}
