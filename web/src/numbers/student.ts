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
  const value = studentQuantile(0.975, whole);
  cache.set(whole, value);
  return value;
}

/** t with P(T <= t) = probability, from 0.5 on; degrees may be infinite: the normal distribution. */
export function studentQuantile(probability: number, degrees: number): number {
  const z = bisected((t) => withinNormal(t), 2 * probability - 1);
  if (degrees > MANY) return z + (z ** 3 + z) / (4 * degrees) + (5 * z ** 5 + 16 * z ** 3 + 3 * z) / (96 * degrees ** 2);
  return bisected((t) => withinProbability(t, degrees), 2 * probability - 1);
}

/** Where a growing function of t >= 0 reaches `share`. */
function bisected(within: (t: number) => number, share: number): number {
  let [low, high] = [0, 1];
  while (within(high) < share && high < 1e6) high *= 2;
  for (let i = 0; i < 60; i++) {
    const middle = (low + high) / 2;
    if (within(middle) < share) low = middle;
    else high = middle;
  }
  return (low + high) / 2;
}

/** P(|Z| <= t) of a standard normal variable: erf by its series (Abramowitz and Stegun 7.1.6), good to 1e-14 up to t = 8. */
function withinNormal(t: number): number {
  let [term, sum] = [t, t];
  for (let n = 1; n < 200 && term > 1e-17 * sum; n++) sum += term *= (t * t) / (2 * n + 1);
  return Math.min(sum * Math.sqrt(2 / Math.PI) * Math.exp((-t * t) / 2), 1);
}

/** From this many replicates on, an interval is shown without "about". */
export const ENOUGH_REPLICATES = 8;
