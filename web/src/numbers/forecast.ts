/** How far a job is and what is left, from its target, its error and the 1/√n law. */
import type { CurvePoint, Job, Target } from '../api/types';
import { duration, percent, roughDuration, roundPercent } from './format';

type Measured = Pick<Job, 'error' | 'seconds' | 'spp' | 'target'> & Partial<Pick<Job, 'error_upper'>>;

/** Fraction done, 0…1. Error falls as 1/√time, so work done is (target/error)²; the target met first wins. */
export function fractionDone(job: Measured): number {
  const { error, seconds, spp } = job.target;
  const fractions = [0];
  // A job stops once it is sure to be below its target: by the upper bound, where there is one.
  const sure = job.error_upper ?? job.error;
  if (error && sure) fractions.push((error / sure) ** 2);
  if (seconds) fractions.push(job.seconds / seconds);
  if (spp) fractions.push(job.spp / spp);
  return Math.min(Math.max(...fractions), 1);
}

/** The factor a of error = a/√seconds through the curve's later half, where start-up costs no longer bend it. */
export function rootLaw(curve: readonly CurvePoint[]): number | null {
  const usable = curve.filter((point) => point.error > 0 && point.seconds > 0);
  if (usable.length < 2) return null;
  const last = usable[usable.length - 1].seconds;
  const later = usable.filter((point) => point.seconds >= last / 4);
  const sum = later.reduce((total, point) => total + Math.log(point.error) + 0.5 * Math.log(point.seconds), 0);
  return Math.exp(sum / later.length);
}

/** What is left, in words; null while nothing honest can be said. */
export function timeLeft(job: Measured & Pick<Job, 'forecast' | 'state'>): string | null {
  if (job.state !== 'running') return null;
  const limits: number[] = [];
  if (job.target.seconds) limits.push(Math.max(job.target.seconds - job.seconds, 0));
  if (job.target.spp && job.spp > 0 && job.seconds > 0)
    limits.push((Math.max(job.target.spp - job.spp, 0) * job.seconds) / job.spp);
  const limit = limits.length > 0 ? Math.min(...limits) : null;
  const left = job.target.error ? (job.forecast?.seconds_left ?? null) : null;
  if (left !== null && (limit === null || left <= limit)) {
    const low = job.forecast?.low ?? null;
    const high = job.forecast?.high ?? null;
    const spread = low !== null && high !== null && high > 1.25 * Math.max(low, 1) ? range(low, high) : '';
    return `${about(left)} of rendering left${spread}`;
  }
  if (limit === null) return null;
  return job.target.error && left === null
    ? `at most ${roughDuration(limit)} of rendering left`
    : `${about(limit)} of rendering left`;
}

/** "about 40 s", but "under 1 s". */
const about = (seconds: number): string => (seconds < 1 ? roughDuration(seconds) : `about ${roughDuration(seconds)}`);

function range(low: number, high: number): string {
  const [from, to] = [roughDuration(low), roughDuration(high)];
  return from === to ? '' : ` (${from} to ${to})`;
}

/** A target said back in one plain sentence. */
export function targetSentence(target: Target): string {
  const parts: string[] = [];
  if (target.error) {
    const where = target.region ? ` in ${target.region[2]} × ${target.region[3]} pixels at (${target.region[0]}, ${target.region[1]})` : '';
    const sure = target.confidence ? `, ${roundPercent(target.confidence)} sure,` : '';
    const whose = target.share ? `of ${roundPercent(target.share)} of the pixels${where}, each by itself,` : where.trim();
    parts.push(`the relative error${whose && ` ${whose}`} is${sure} at most ${roundPercent(target.error)}`);
  }
  if (target.seconds) parts.push(`${duration(target.seconds)} of rendering have passed`);
  if (target.spp) parts.push(`every pixel has ${target.spp} samples`);
  if (parts.length === 0) return 'Give at least one target: an error, a time or a number of samples.';
  if (parts.length === 1) return `Stops when ${parts[0]}.`;
  const first = parts.length === 2 ? 'whichever comes first' : 'whichever of the three comes first';
  return `Stops when ${parts.slice(0, -1).join(', ')} or ${parts[parts.length - 1]}, ${first}.`;
}

/** A target in a few characters, for a row: "2 % · 1 min". */
export function targetInShort(target: Target): string {
  const parts: string[] = [];
  if (target.error) parts.push(roundPercent(target.error));
  if (target.seconds) parts.push(duration(target.seconds));
  if (target.spp) parts.push(`${target.spp}\u00a0spp`);
  return parts.join(' or ');
}

/** How a job ended, in one sentence. */
export function outcome(job: Measured & Pick<Job, 'stopped_by' | 'state'>): string {
  const time = duration(job.seconds);
  if (job.state === 'cancelled') return job.error ? `Cancelled at ${percent(job.error)} after ${time}` : `Cancelled after ${time}`;
  const error = job.error === null ? 'the error is not known' : percent(job.error);
  const wanted = job.target.error ? `, target was ${roundPercent(job.target.error)}` : '';
  switch (job.stopped_by) {
    case 'error':
      return `Reached ${error} in ${time}`;
    case 'seconds':
      return `Time used up: ${error}${wanted}`;
    case 'spp':
      return `All samples taken: ${error}${wanted}`;
    default:
      return job.error === null ? `Ended after ${time}: ${error}` : `Ended at ${error} after ${time}`;
  }
}

/** A job in a few words, to tell it from others of the same scene: "mis · 2.1 % in 34 s". */
export function jobInShort(job: Pick<Job, 'error' | 'seconds' | 'settings'>): string {
  return `${job.settings.technique} · ${job.error === null ? 'error not known' : percent(job.error)} in ${duration(job.seconds)}`;
}
