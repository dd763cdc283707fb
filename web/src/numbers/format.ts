/** Numbers as words. A narrow no-break space keeps a number and its unit on one line. */
const THIN = '\u202f';
const NO_BREAK = '\u00a0';

/** Relative number as a percentage with about `digits` significant digits: 0.0315 → "3.2 %". */
export function percent(value: number | null | undefined, digits = 2): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  return `${plain(value * 100, digits)}${THIN}%`;
}

/** A chosen number, without the zeros that only measured ones need: 0.02 → "2 %". */
export const roundPercent = (value: number): string => `${+(value * 100).toPrecision(3)}${THIN}%`;

/** Significant digits without an exponent and without rounding whole digits away: 123.4 → "123", 0.0456 → "0.046". */
export function plain(value: number, digits: number): string {
  if (value === 0) return '0';
  const magnitude = Math.floor(Math.log10(Math.abs(value)) + 1e-9);
  return value.toFixed(Math.min(Math.max(digits - 1 - magnitude, 0), 12));
}

/** Seconds as a person says them: "0.4 s", "42 s", "1 min 52 s", "2 h 5 min". */
export function duration(seconds: number): string {
  if (!Number.isFinite(seconds)) return '–';
  if (seconds >= 1 && seconds < 10 && Number.isInteger(seconds)) return `${seconds}${NO_BREAK}s`;
  if (seconds < 9.95) return `${plain(Math.max(seconds, 0), seconds < 1 ? 1 : 2)}${NO_BREAK}s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole}${NO_BREAK}s`;
  if (whole < 3600) return joined(Math.floor(whole / 60), 'min', whole % 60, 's');
  const minutes = Math.round(seconds / 60);
  if (minutes < 48 * 60) return joined(Math.floor(minutes / 60), 'h', minutes % 60, 'min');
  return joined(Math.floor(minutes / 1440), 'd', Math.round((minutes % 1440) / 60), 'h');
}

/** A rough duration for forecasts: "40 s", "2 min", "1.5 h". */
export function roughDuration(seconds: number): string {
  if (seconds < 1) return `under 1${NO_BREAK}s`;
  if (seconds < 10) return `${Math.round(seconds)}${NO_BREAK}s`;
  if (seconds < 55) return `${Math.round(seconds / 5) * 5}${NO_BREAK}s`;
  if (seconds < 55 * 60) return `${Math.max(1, Math.round(seconds / 60))}${NO_BREAK}min`;
  return `${plain(seconds / 3600, seconds < 36000 ? 2 : 1).replace(/\.0$/, '')}${NO_BREAK}h`;
}

/** Axis label of a round duration: "0.2 s", "5 s", "2 min", "1 h". */
export function tickDuration(seconds: number): string {
  if (seconds < 60) return `${+seconds.toPrecision(3)}${NO_BREAK}s`;
  if (seconds < 3600) return `${+(seconds / 60).toPrecision(3)}${NO_BREAK}min`;
  return `${+(seconds / 3600).toPrecision(3)}${NO_BREAK}h`;
}

/** When something was, as short as can be: the time today, else the day, with the year where it is another one. */
export function when(then: Date, now: Date, language?: string): string {
  if (Number.isNaN(then.getTime())) return '–';
  const has = (part: (date: Date) => number): boolean => part(then) === part(now);
  const isThisYear = has((date) => date.getFullYear());
  if (isThisYear && has((date) => date.getMonth()) && has((date) => date.getDate()))
    return then.toLocaleTimeString(language, { hour: '2-digit', minute: '2-digit' });
  return then.toLocaleDateString(language, { day: 'numeric', month: 'short', ...(isThisYear ? {} : { year: 'numeric' }) });
}

export function ordinal(n: number): string {
  const tens = n % 100;
  const suffix = tens >= 11 && tens <= 13 ? 'th' : (['th', 'st', 'nd', 'rd'][n % 10] ?? 'th');
  return `${n}${suffix}`;
}

export function count(n: number): string {
  if (n < 9.95) return String(+n.toFixed(1));
  if (n < 10_000) return String(Math.round(n));
  const [scale, letter] = n < 999_500 ? [1e3, 'k'] : n < 999_500_000 ? [1e6, 'M'] : [1e9, 'G'];
  return `${plain(n / scale, 3)}${THIN}${letter}`;
}

export function bytes(n: number): string {
  if (n < 1000) return `${n}${NO_BREAK}B`;
  if (n < 999_500) return `${plain(n / 1e3, 3)}${NO_BREAK}kB`;
  return `${plain(n / 1e6, 3)}${NO_BREAK}MB`;
}

/** Radiance with four significant digits; very small and very large numbers with an exponent. */
export function radiance(value: number | null | undefined): string {
  if (value === null || value === undefined || Number.isNaN(value)) return 'NaN';
  if (!Number.isFinite(value)) return value > 0 ? '∞' : '−∞';
  if (value === 0) return '0';
  const magnitude = Math.abs(value);
  const text = magnitude < 1e-4 || magnitude >= 1e5 ? value.toExponential(3) : plain(value, 4);
  return text.replace('-', '−');
}

/** Value and half-width, both rounded to the half-width's second digit: 0.24561 ± 0.01346 → ["0.246", "0.013"]. */
export function withError(value: number, half: number): [string, string] {
  if (!Number.isFinite(half) || half <= 0) return [radiance(value), half === 0 ? '0' : '?'];
  if (Math.abs(value) >= 1e5 || half >= 1e5 || half < 1e-7) return [radiance(value), half.toExponential(1)];
  const decimals = Math.min(Math.max(1 - Math.floor(Math.log10(half)), 0), 9);
  return [value.toFixed(decimals).replace('-', '−'), half.toFixed(decimals)];
}

/** Time since `from` for a picture's age: "just now", "12 s ago". */
export const age = (seconds: number): string => (seconds < 2 ? 'just now' : `${roughDuration(seconds)} ago`);

/** When a waiting job is expected to begin. */
export const startsIn = (seconds: number): string => (seconds < 2 ? 'about to start' : `starts in about ${roughDuration(seconds)}`);

function joined(high: number, highUnit: string, low: number, lowUnit: string): string {
  const head = `${high}${NO_BREAK}${highUnit}`;
  return low === 0 ? head : `${head}${NO_BREAK}${low}${NO_BREAK}${lowUnit}`;
}
