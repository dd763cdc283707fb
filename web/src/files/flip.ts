/**
 * FLIP between two pictures in linear RGB: Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (HPG 2020), and over
 * exposures "Visualizing Errors in Rendered High Dynamic Range Images" (Eurographics 2021), with the constants of both papers and
 * the separated filters of the authors' note. Seen from 0.7 m on a screen 0.7 m and 3840 pixels wide, as theirs by default.
 */
export type Planes = readonly [Float32Array, Float32Array, Float32Array];

const PIXELS_PER_DEGREE = (0.7 * 3840) / 0.7 * (Math.PI / 180);
const [COLOUR_POWER, KNEE, KNEE_TO, FEATURE_WIDTH, FEATURE_POWER] = [0.7, 0.4, 0.95, 0.082, 0.5];
/** Weights and widths of the contrast sensitivity's Gaussians. */
const SENSITIVITY = { y: [1, 0.0047], x: [1, 0.0053], z1: [34.1, 0.04], z2: [13.5, 0.025] } as const;
const ACES = [0.36 * 2.51, 0.6 * 0.03, 0, 0.36 * 2.43, 0.6 * 0.59, 0.14] as const;
const WHITE = [0.950428545, 1, 1.088900371] as const;
const TO_XYZ = [
  [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
  [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
  [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
] as const;
const TO_RGB = [
  [3.241003275, -1.537398934, -0.498615861],
  [-0.969224334, 1.875930071, 0.041554224],
  [0.055639423, -0.204011202, 1.057148933],
] as const;

export interface Flip {
  /** Of all pixels: 0 is no visible difference, 1 the largest. */
  mean: number;
  /** In stops; of pictures that are shown as they are, null. */
  exposures: { from: number; to: number; count: number } | null;
}

/** Values from 0 to 1, as shown: each pixel's error in [0, 1]. */
export function ldrFlip(reference: Planes, test: Planes, width: number, height: number): Float32Array {
  const [r, t] = [opponent(reference), opponent(test)];
  const error = colourDifference(r, t, width, height);
  addFeatures(error, r[0], t[0], width, height);
  return error;
}

/** The largest error over the exposures that the reference asks for. */
export function hdrFlip(reference: Planes, test: Planes, width: number, height: number): Flip {
  const { from, to } = exposuresOf(reference);
  const count = Math.max(2, Math.ceil(to - from));
  const worst = new Float32Array(width * height);
  for (let i = 0; i < count; i++) {
    const gain = 2 ** (from + (i * (to - from)) / (count - 1));
    const error = ldrFlip(exposed(reference, gain), exposed(test, gain), width, height);
    for (let p = 0; p < error.length; p++) if (error[p] > worst[p]) worst[p] = error[p];
  }
  return { mean: worst.reduce((sum, value) => sum + value, 0) / worst.length, exposures: { from, to, count } };
}

/** From where the brightest pixel is just not white to where the median is. */
function exposuresOf([r, g, b]: Planes): { from: number; to: number } {
  const luminance = r.map((red, i) => 0.2126 * red + 0.7152 * g[i] + 0.0722 * b[i]).sort();
  const [qa, qb, qc] = [0, 1, 2].map((i) => ACES[i] - 0.85 * ACES[i + 3]);
  const middle = (-0.5 * qb) / qa;
  const white = middle + Math.sqrt(middle * middle - qc / qa);
  const median = Math.max(luminance[luminance.length >> 1], 1.1920929e-7);
  return { from: Math.log2(white / luminance[luminance.length - 1]), to: Math.log2(white / median) };
}

function exposed(planes: Planes, gain: number): Planes {
  const shown = (value: number): number => {
    const v = value * gain;
    return Math.min(Math.max((v * (ACES[0] * v + ACES[1]) + ACES[2]) / (v * (ACES[3] * v + ACES[4]) + ACES[5]), 0), 1);
  };
  return [planes[0].map(shown), planes[1].map(shown), planes[2].map(shown)];
}

/** YCxCz of linear RGB. */
function opponent([r, g, b]: Planes): Planes {
  const n = r.length;
  const planes: Planes = [new Float32Array(n), new Float32Array(n), new Float32Array(n)];
  for (let i = 0; i < n; i++) {
    const [x, y, z] = xyz(r[i], g[i], b[i]);
    planes[0][i] = 116 * y - 16;
    planes[1][i] = 500 * (x - y);
    planes[2][i] = 200 * (y - z);
  }
  return planes;
}

/** Relative to the white point. */
const xyz = (r: number, g: number, b: number): [number, number, number] => [
  (TO_XYZ[0][0] * r + TO_XYZ[0][1] * g + TO_XYZ[0][2] * b) / WHITE[0],
  TO_XYZ[1][0] * r + TO_XYZ[1][1] * g + TO_XYZ[1][2] * b,
  (TO_XYZ[2][0] * r + TO_XYZ[2][1] * g + TO_XYZ[2][2] * b) / WHITE[2],
];

const root = (t: number): number => (t > 216 / 24389 ? Math.cbrt(t) : (841 / 108) * t + 4 / 29);

/** CIELab with Hunt's adjustment: colours matter less where it is dark. */
function hunted(r: number, g: number, b: number): [number, number, number] {
  const [x, y, z] = xyz(r, g, b).map(root);
  const lightness = 116 * y - 16;
  return [lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)];
}

const apart = (a: readonly number[], b: readonly number[]): number => (Math.abs(a[0] - b[0]) + Math.hypot(a[1] - b[1], a[2] - b[2])) ** COLOUR_POWER;

function colourDifference(reference: Planes, test: Planes, width: number, height: number): Float32Array {
  const filters = spatialFilters();
  const blurred = ([y, cx, cz]: Planes): Float32Array[] => {
    const twice = (plane: Float32Array, filter: Float64Array): Float32Array => down(across(plane, filter, width, height), filter, width, height);
    const [first, second] = [twice(cz, filters.z1), twice(cz, filters.z2)];
    return [twice(y, filters.y), twice(cx, filters.x), first.map((value, i) => value + second[i])];
  };
  const [r, t] = [blurred(reference), blurred(test)];
  const largest = apart(hunted(0, 1, 0), hunted(0, 0, 1));
  const knee = KNEE * largest;
  const error = new Float32Array(width * height);
  for (let i = 0; i < error.length; i++) {
    const colour = apart(seen(r[0][i], r[1][i], r[2][i]), seen(t[0][i], t[1][i], t[2][i]));
    error[i] = colour < knee ? (colour * KNEE_TO) / knee : KNEE_TO + ((colour - knee) / (largest - knee)) * (1 - KNEE_TO);
  }
  return error;
}

/** What is left of filtered YCxCz on a screen, in Hunt's CIELab. */
function seen(y: number, cx: number, cz: number): [number, number, number] {
  const middle = (y + 16) / 116;
  const [x, z] = [(middle + cx / 500) * WHITE[0], (middle - cz / 200) * WHITE[2]];
  const clamped = (row: readonly [number, number, number]): number => Math.min(Math.max(row[0] * x + row[1] * middle + row[2] * z, 0), 1);
  return hunted(clamped(TO_RGB[0]), clamped(TO_RGB[1]), clamped(TO_RGB[2]));
}

function spatialFilters(): Record<'y' | 'x' | 'z1' | 'z2', Float64Array> {
  const radius = Math.ceil(3 * Math.sqrt(0.04 / (2 * Math.PI ** 2)) * PIXELS_PER_DEGREE);
  const along = (weight: (squared: number) => number): Float64Array =>
    Float64Array.from({ length: 2 * radius + 1 }, (_, i) => weight(((i - radius) / PIXELS_PER_DEGREE) ** 2));
  const gaussian = ([, b]: readonly [number, number]): Float64Array => scaled(along((squared) => Math.exp((-(Math.PI ** 2) * squared) / b)));
  // Along one axis each: the root of the two-dimensional weight.
  const part = ([a, b]: readonly [number, number]): Float64Array =>
    along((squared) => Math.sqrt(a * Math.sqrt(Math.PI / b)) * Math.exp((-(Math.PI ** 2) * squared) / b));
  const [first, second] = [part(SENSITIVITY.z1), part(SENSITIVITY.z2)];
  const norm = Math.hypot(sumOf(first), sumOf(second));
  return { y: gaussian(SENSITIVITY.y), x: gaussian(SENSITIVITY.x), z1: first.map((v) => v / norm), z2: second.map((v) => v / norm) };
}

/** Edges and points that one picture has and the other lacks sharpen the error. */
function addFeatures(error: Float32Array, reference: Float32Array, test: Float32Array, width: number, height: number): void {
  const { blur, edge, point } = featureFilters();
  const strengths = (plane: Float32Array): [Float32Array, Float32Array] => {
    const y = plane.map((value) => (value + 16) / 116);
    const blurred = across(y, blur, width, height);
    const both = (filter: Float64Array): Float32Array => {
      const dx = down(across(y, filter, width, height), blur, width, height);
      const dy = down(blurred, filter, width, height);
      return dx.map((value, i) => Math.hypot(value, dy[i]));
    };
    return [both(edge), both(point)];
  };
  const [r, t] = [strengths(reference), strengths(test)];
  for (let i = 0; i < error.length; i++) {
    const most = Math.max(Math.abs(r[0][i] - t[0][i]), Math.abs(r[1][i] - t[1][i]));
    error[i] **= 1 - (Math.SQRT1_2 * most) ** FEATURE_POWER;
  }
}

function featureFilters(): Record<'blur' | 'edge' | 'point', Float64Array> {
  const deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
  const radius = Math.ceil(3 * deviation);
  const at = Float64Array.from({ length: 2 * radius + 1 }, (_, i) => i - radius);
  const gaussian = at.map((x) => Math.exp((-x * x) / (2 * deviation * deviation)));
  // Positive weights sum to 1, negative ones to −1.
  const balanced = (weights: Float64Array): Float64Array => {
    const [plus, minus] = [sumOf(weights.map((w) => Math.max(w, 0))), -sumOf(weights.map((w) => Math.min(w, 0)))];
    return weights.map((w) => w / (w > 0 ? plus : minus));
  };
  return {
    blur: scaled(gaussian),
    edge: balanced(at.map((x, i) => -x * gaussian[i])),
    point: balanced(at.map((x, i) => ((x * x) / (deviation * deviation) - 1) * gaussian[i])),
  };
}

const sumOf = (weights: Float64Array): number => weights.reduce((sum, weight) => sum + weight, 0);
const scaled = (weights: Float64Array): Float64Array => weights.map((weight) => weight / sumOf(weights));

/** Filters along rows; beyond the edge its pixels go on. */
export function across(plane: Float32Array, filter: Float64Array, width: number, height: number): Float32Array {
  const radius = filter.length >> 1;
  const result = new Float32Array(plane.length);
  const row = new Float32Array(width + 2 * radius);
  for (let y = 0; y < height; y++) {
    row.set(plane.subarray(y * width, (y + 1) * width), radius);
    row.fill(row[radius], 0, radius).fill(row[radius + width - 1], radius + width);
    for (let x = 0; x < width; x++) {
      let sum = 0;
      for (let i = 0; i < filter.length; i++) sum += filter[i] * row[x + i];
      result[y * width + x] = sum;
    }
  }
  return result;
}

/** Filters along columns. */
export function down(plane: Float32Array, filter: Float64Array, width: number, height: number): Float32Array {
  const radius = filter.length >> 1;
  const result = new Float32Array(plane.length);
  const sums = new Float64Array(width);
  for (let y = 0; y < height; y++) {
    sums.fill(0);
    for (let i = 0; i < filter.length; i++) {
      const from = Math.min(Math.max(y + i - radius, 0), height - 1) * width;
      for (let x = 0; x < width; x++) sums[x] += filter[i] * plane[from + x];
    }
    result.set(sums, y * width);
  }
  return result;
}
