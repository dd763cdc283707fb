/** How the list of jobs and a curve change with what arrives. Pure, so that late and repeated messages can be tested. */
import { type CurvePoint, isEnded, type Job, type Progress } from '../api/types';

/** Newest first; an ended job is never overtaken by an older message that says it still runs. */
export function withJob(jobs: readonly Job[], incoming: Job): Job[] {
  const known = jobs.find((job) => job.id === incoming.id);
  if (known && isStale(known, incoming)) return jobs as Job[];
  const { curve: _, ...job } = incoming;
  const others = jobs.filter((entry) => entry.id !== job.id);
  return [...others, job].sort((a, b) => (a.created_at < b.created_at ? 1 : a.created_at > b.created_at ? -1 : 0));
}

/** The newest jobs of `total`, fresh from the service: jobs that lie within the list's reach and are not in it are gone. */
export function withList(jobs: readonly Job[], list: readonly Job[], total: number): Job[] {
  const oldest = list[list.length - 1]?.created_at;
  const isBeyond = (job: Job): boolean => list.length < total && oldest !== undefined && job.created_at < oldest;
  const kept = jobs.filter((job) => isBeyond(job) || list.some((entry) => entry.id === job.id));
  return list.reduce<Job[]>((folded, job) => withJob(folded, job), kept);
}

export function withProgress(jobs: readonly Job[], progress: Progress): Job[] {
  return jobs.map((job) => {
    if (job.id !== progress.id || (isEnded(job.state) && !isEnded(progress.state))) return job;
    if (progress.frame_seq < job.frame_seq) return job;
    return { ...job, ...progress };
  });
}

/** Appends a point where time has gone on; the service's own curve replaces all of it when it is read anew. */
export function withPoint(curve: readonly CurvePoint[], progress: Progress | Job): CurvePoint[] {
  const last = curve[curve.length - 1];
  const { seconds, spp, error, error_upper: upper = null } = progress;
  if (error === null || error <= 0 || (last && seconds <= last.seconds)) return curve as CurvePoint[];
  return [...curve, { seconds, spp, error, upper }];
}

function isStale(known: Job, incoming: Job): boolean {
  if (isEnded(known.state) && !isEnded(incoming.state)) return true;
  return known.state === incoming.state && incoming.frame_seq < known.frame_seq;
}
