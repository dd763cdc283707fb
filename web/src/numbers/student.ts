/**
 * Student's t distribution for whole degrees of freedom: the finite trigonometric sums of Abramowitz and
 * Stegun 26.7.3 and 26.7.4, and beyond 200 degrees the expansion 26.7.5 around the normal quantile.
 */
const MANY = 200;

/** P(|T| <= t) for `degrees` degrees of freedom. */
export function withinProbability(t: number, degrees: number): number {
  const theta = Math.atan(t / Math.sqrt(degrees));
  const sine = Math.sin(theta);
  const cosine = Math.cos(theta);
  const square = cosine * cosine;
  let term = degrees % 2 === 0 ? 1 : cosine;
  let sum = degrees === 1 ? 0 : term;
  for (let k = degrees % 2 === 0 ? 2 : 3; k <= degrees - 2; k += 2) {
    term *= (square * (k - 1)) / k;
    sum += term;
  }
  return degrees % 2 === 0 ? sine * sum : (2 / Math.PI) * (theta + sine * sum);
}

const cache = new Map<number, number>();

/** Half-width of the two-sided 95 % interval in standard errors. NaN below one degree of freedom. */
export function t95(degrees: number): number {
  if (!(degrees >= 1)) return Number.NaN;
  const whole = Math.floor(degrees);
  const known = cache.get(whole);
  if (known !== undefined) return known;
  const value = whole > MANY ? expanded(whole) : bisected(whole);
  cache.set(whole, value);
  return value;
}

function bisected(degrees: number): number {
  let low = 1.9;
  let high = 13;
  for (let i = 0; i < 50; i++) {
    const middle = (low + high) / 2;
    if (withinProbability(middle, degrees) < 0.95) low = middle;
    else high = middle;
  }
  return (low + high) / 2;
}

function expanded(degrees: number): number {
  const z = 1.959963984540054;
  return z + (z ** 3 + z) / (4 * degrees) + (5 * z ** 5 + 16 * z ** 3 + 3 * z) / (96 * degrees ** 2);
}

/** From this many replicates on, an interval is shown without "about". */
export const ENOUGH_REPLICATES = 8;
