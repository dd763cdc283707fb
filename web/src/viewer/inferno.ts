/** The inferno colour map as a polynomial of degree six (within 1/50 of matplotlib's table), for legend and shader alike. */
const COEFFICIENTS: readonly (readonly [number, number, number])[] = [
  [0.0002189403691192265, 0.001651004631001012, -0.01948089843709184],
  [0.1065134194856116, 0.5639564367884091, 3.932712388889277],
  [11.60249308247187, -3.972853965665698, -15.9423941062914],
  [-41.70399613139459, 17.43639888205313, 44.35414519872813],
  [77.162935699427, -33.40235894210092, -81.80730925738993],
  [-71.31942824499214, 32.62606426397723, 73.20951985803202],
  [25.13112622477341, -12.24266895238567, -23.07032500287172],
];

/** sRGB colour, 0…255 per channel, at position `at` in 0…1. */
export function inferno(at: number): [number, number, number] {
  const t = Math.min(Math.max(at, 0), 1);
  const channel = (c: 0 | 1 | 2): number => {
    const value = COEFFICIENTS.reduceRight((sum, row) => sum * t + row[c], 0);
    return Math.round(255 * Math.min(Math.max(value, 0), 1));
  };
  return [channel(0), channel(1), channel(2)];
}

/** 256 RGBA texels. */
export function infernoTexels(): Uint8Array {
  const texels = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; i++) texels.set([...inferno(i / 255), 255], 4 * i);
  return texels;
}
