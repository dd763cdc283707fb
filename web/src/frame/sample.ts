/** Frames made by hand, for tests. */
import type { FrameHeader } from './decode';

export const ONE = 0x3c00;
export const INFINITE = 0x7c00;
export const NOT_A_NUMBER = 0x7e00;

/** A body as the service writes it, from (R, G, B, SE) or (R, G, B, SE, N) patterns per pixel, row by row. */
export function frameBody(header: Partial<FrameHeader>, pixels: readonly (readonly number[])[]): ArrayBuffer {
  const full = {
    seq: 1, width: pixels.length, height: 1, spp_min: 16, spp_max: 16, spp_mean: 16, replicates_min: 8, replicates_max: 8,
    seconds: 1, scale: 1, reduce: 1, layout: 'byteplanes-half', filled: false, replicate_size: 2,
    channels: ['R', 'G', 'B', 'SE', 'N'].slice(0, pixels[0].length), ...header,
  }; // prettier-ignore
  let text = JSON.stringify(full);
  text = text.padEnd(Math.ceil((8 + text.length) / 8) * 8 - 8);
  const n = pixels.length;
  const planes = pixels[0].length;
  const body = new Uint8Array(8 + text.length + 2 * planes * n);
  body.set(new TextEncoder().encode('FRD1'));
  new DataView(body.buffer).setUint32(4, text.length, true);
  body.set(new TextEncoder().encode(text), 8);
  pixels.forEach((pixel, i) =>
    pixel.forEach((bits, channel) => {
      body[8 + text.length + channel * n + i] = bits & 255;
      body[8 + text.length + (planes + channel) * n + i] = bits >> 8;
    }),
  );
  return body.buffer;
}
