/** How far a picture is from a reference, by the measures that papers use, and whether its intervals keep what they say. */
import { t95 } from '../numbers/student';
import { across, down, type Flip, hdrFlip, type Planes } from './flip';
import { FileError, layersOf, type Raster, threeOf } from './raster';

export interface Metrics {
  /** Mean over pixels and R, G, B. */
  mse: number;
  /** The same over reference² + (0.1 · its mean)²: as `renderer.rel_mse`. */
  relMse: number;
  /** Null where nothing in the reference is lit. */
  flip: Flip | null;
  /** Of both as sRGB, clipped at white; null of pictures under 11 pixels a side. */
  ssim: number | null;
  /** Null where the picture has no intervals. */
  coverage: Coverage | null;
  /** Pixels that are not a number in one of the two, and are left out (of FLIP and SSIM: taken as black). */
  invalid: number;
}

export interface Coverage {
  /** Pixels whose interval is trusted; of a reference with intervals of its own: in both. */
  trusted: number;
  /** Of those: how many 95 % intervals of luminance hold the reference. */
  held: number;
  /** The reference has standard errors of its own, which were counted in. */
  isJoint: boolean;
}

const LUMA = [0.2126, 0.7152, 0.0722] as const;

/** Raises FileError where the sizes differ. */
export function compare(picture: Raster, reference: Raster): Metrics {
  const { width, height } = picture;
  if (width !== reference.width || height !== reference.height)
    throw new FileError(`the reference has ${reference.width} × ${reference.height} pixels, the picture ${width} × ${height}: they can only be compared at one size`);
  const [a, r] = [mainOf(picture), mainOf(reference)];
  const isValid = (i: number): boolean => [a, r].every((planes) => planes.every((plane) => Number.isFinite(plane[i])));
  const valid = Uint8Array.from(a[0], (_, i) => (isValid(i) ? 1 : 0));
  const invalid = valid.reduce((count, one) => count + 1 - one, 0);
  const shown = (planes: Planes): Planes => planes.map((plane) => plane.map((value, i) => (valid[i] ? Math.max(value, 0) : 0))) as unknown as Planes;
  const [shownA, shownR] = [shown(a), shown(r)];
  const isLit = shownR.some((plane) => plane.some((value) => value > 0));
  return {
    ...squaredErrors(a, r, valid),
    flip: isLit ? hdrFlip(shownR, shownA, width, height) : null,
    ssim: Math.min(width, height) < 11 ? null : ssim(shownA, shownR, width, height),
    coverage: coverageOf(picture, reference, valid),
    invalid,
  };
}

export const mainOf = (raster: Raster): Planes => threeOf(raster, layersOf(raster.planes.keys())[0]);

function squaredErrors(a: Planes, r: Planes, valid: Uint8Array): Pick<Metrics, 'mse' | 'relMse'> {
  let [sum, total] = [0, 0];
  for (let c = 0; c < 3; c++) for (let i = 0; i < valid.length; i++) if (valid[i]) [sum, total] = [sum + r[c][i], total + 1];
  const mean = sum / total;
  const floor = Math.max((0.1 * mean) ** 2, Number.MIN_VALUE);
  let [squared, relative] = [0, 0];
  for (let c = 0; c < 3; c++) {
    for (let i = 0; i < valid.length; i++) {
      if (!valid[i]) continue;
      const square = (a[c][i] - r[c][i]) ** 2;
      squared += square;
      relative += square / (r[c][i] ** 2 + floor);
    }
  }
  return { mse: squared / total, relMse: relative / total };
}

/**
 * Structural similarity (Wang et al. 2004) of sRGB values: Gaussian windows of 1.5 pixels, 11 wide, means over R, G, B and over the
 * pixels whose window lies inside.
 */
export function ssim(a: Planes, r: Planes, width: number, height: number): number {
  const window = Float64Array.from({ length: 11 }, (_, i) => Math.exp(-((i - 5) ** 2) / (2 * 1.5 ** 2)));
  const weight = window.reduce((sum, value) => sum + value, 0);
  const filter = window.map((value) => value / weight);
  const blur = (plane: Float32Array): Float32Array => down(across(plane, filter, width, height), filter, width, height);
  let sum = 0;
  for (let c = 0; c < 3; c++) {
    const [x, y] = [a[c].map(srgb), r[c].map(srgb)];
    const [mx, my] = [blur(x), blur(y)];
    const [xx, yy, xy] = [blur(x.map((v) => v * v)), blur(y.map((v) => v * v)), blur(x.map((v, i) => v * y[i]))];
    for (let row = 5; row < height - 5; row++) {
      for (let column = 5; column < width - 5; column++) {
        const i = row * width + column;
        const [vx, vy, covariance] = [xx[i] - mx[i] ** 2, yy[i] - my[i] ** 2, xy[i] - mx[i] * my[i]];
        sum += ((2 * mx[i] * my[i] + 0.01 ** 2) * (2 * covariance + 0.03 ** 2)) / ((mx[i] ** 2 + my[i] ** 2 + 0.01 ** 2) * (vx + vy + 0.03 ** 2));
      }
    }
  }
  return sum / (3 * (width - 10) * (height - 10));
}

function srgb(linear: number): number {
  const v = Math.min(Math.max(linear, 0), 1);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
}

function coverageOf(picture: Raster, reference: Raster, valid: Uint8Array): Coverage | null {
  const [error, count, trust] = ['stderr.Y', 'count', 'trust'].map((name) => picture.planes.get(name));
  if (!error || !count || !trust) return null;
  const [ownError, ownCount, ownTrust] = ['stderr.Y', 'count', 'trust'].map((name) => reference.planes.get(name));
  const isJoint = !!ownError && !!ownCount && !!ownTrust;
  const [a, r] = [mainOf(picture), mainOf(reference)];
  const luminance = (planes: Planes, i: number): number => LUMA[0] * planes[0][i] + LUMA[1] * planes[1][i] + LUMA[2] * planes[2][i];
  const found = { trusted: 0, held: 0, isJoint };
  for (let i = 0; i < valid.length; i++) {
    if (!valid[i] || !(trust[i] > 0) || (isJoint && !(ownTrust[i] > 0))) continue;
    const [v, w] = [error[i] ** 2, isJoint ? ownError[i] ** 2 : 0];
    if (!(v > 0) || !Number.isFinite(v + w)) continue;
    // Welch's and Satterthwaite's degrees of freedom.
    const freedom = (v + w) ** 2 / (v ** 2 / (count[i] - 1) + (isJoint ? w ** 2 / (ownCount[i] - 1) : 0));
    found.trusted++;
    if (Math.abs(luminance(a, i) - luminance(r, i)) <= t95(freedom) * Math.sqrt(v + w)) found.held++;
  }
  return found.trusted > 0 ? found : null;
}
