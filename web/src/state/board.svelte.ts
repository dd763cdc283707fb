/** All jobs, as the list, the event stream and the user's own requests tell them. */
import { getJob, listGallery, listJobs } from '../api/client';
import { type Connection, EventStream, pauseWhileHidden } from '../api/events';
import { isAbort, problemOf } from '../api/problem';
import { type CurvePoint, type GalleryScene, isEnded, type Job, type Progress } from '../api/types';
import type { Queue } from '../api/messages';
import { type Place, placesOf } from '../numbers/queue';
import { session } from './session.svelte';
import { withJob, withList, withPoint, withProgress } from './fold';

/** Jobs that are read at a time. */
const PAGE = 200;

class Board {
  /** Newest first. */
  jobs = $state.raw<Job[]>([]);
  curves = $state.raw<Record<string, CurvePoint[]>>({});
  /** Ids of jobs that were deleted while this page was open. */
  deleted = $state.raw<ReadonlySet<string>>(new Set());
  gallery = $state.raw<GalleryScene[]>([]);
  /** How many jobs the service has; those beyond the newest are read when they are asked for. */
  total = $state(0);
  isReadingOlder = $state(false);
  /** Where queued jobs stand: only ever replaced as a whole. */
  private places = $state.raw<ReadonlyMap<string, Place>>(new Map());
  connection = $state<Connection>('connecting');
  hasList = $state(false);
  /** Counts server restarts; frames of an earlier one are void. */
  serverGeneration = $state(0);
  private server: string | null = null;
  /** The oldest job that a list has told of. */
  private lastListed: string | null = null;

  readonly stream = new EventStream({
    open: () => new EventSource('api/events'),
    onConnected: () => void this.reload(),
    onConnection: (state) => {
      // A key that was taken back ends the stream, too: only the session can tell why.
      if (state === 'lost' && this.connection !== 'lost') void session.check(window);
      this.connection = state;
    },
    onEvent: (type, data) => this.take(type, data),
  });

  start(page: Document): () => void {
    this.stream.start();
    const unwatch = pauseWhileHidden(this.stream, page);
    return () => {
      unwatch();
      this.stream.stop();
    };
  }

  async reload(): Promise<void> {
    void session.check(window);
    try {
      const { jobs, total } = await listJobs(Math.max(this.jobs.length, PAGE));
      this.jobs = withList(this.jobs, jobs, total);
      this.lastListed = jobs[jobs.length - 1]?.id ?? null;
      this.total = total;
      this.hasList = true;
      if (this.gallery.length === 0) this.gallery = await listGallery();
    } catch {
      // The stream's own state says that the service is away; it calls again when it is back.
    }
  }

  get hasOlder(): boolean {
    return this.jobs.length < this.total;
  }

  /** Reads the next page of older jobs. */
  async readOlder(): Promise<void> {
    const oldest = this.jobs[this.jobs.length - 1];
    if (this.isReadingOlder || !this.hasOlder || !oldest) return;
    this.isReadingOlder = true;
    try {
      // A job that was opened by its link may be older than others that were not read yet: go on after the list itself.
      const { jobs, total } = await listJobs(PAGE, this.lastListed ?? oldest.id);
      this.jobs = jobs.reduce<Job[]>((folded, job) => withJob(folded, job), this.jobs);
      this.lastListed = jobs[jobs.length - 1]?.id ?? this.lastListed;
      this.total = jobs.length === 0 ? this.jobs.length : total;
    } catch {
      // Where the list went on is gone: begin anew.
      await this.reload();
    } finally {
      this.isReadingOlder = false;
    }
  }

  placeOf(job: Job): Place | null {
    return job.state === 'queued' ? (this.places.get(job.id) ?? null) : null;
  }

  /** Reads one job with its curve. Resolves to false where there is no such job. */
  async read(id: string, signal: AbortSignal): Promise<boolean> {
    try {
      const job = await getJob(id, signal);
      this.accept(job);
      if (job.curve) this.curves = { ...this.curves, [id]: job.curve };
      return true;
    } catch (cause) {
      return isAbort(cause) || problemOf(cause).status !== 404;
    }
  }

  accept(job: Job): void {
    const before = this.jobs.length;
    this.jobs = withJob(this.jobs, job);
    // One that is new to the page is new to the service too, unless it was opened by its link.
    if (this.hasList && this.jobs.length > before && this.jobs[0].id === job.id) this.total++;
    this.extendCurve(job);
  }

  /** The job has been deleted. */
  forget(id: string): void {
    const before = this.jobs.length;
    this.jobs = this.jobs.filter((job) => job.id !== id);
    this.total -= before - this.jobs.length;
    this.deleted = new Set([...this.deleted, id]);
  }

  sceneOf(job: Job): GalleryScene | null {
    return this.gallery.find((scene) => scene.name === job.scene.gallery) ?? null;
  }

  private take(type: string, data: unknown): void {
    if (typeof data !== 'object' || data === null) return;
    switch (type) {
      case 'hello': {
        const server = (data as { server?: string }).server ?? null;
        if (this.server !== null && server !== this.server) this.startOver();
        this.server = server;
        break;
      }
      case 'job':
        this.accept(data as Job);
        break;
      case 'progress':
        this.jobs = withProgress(this.jobs, data as Progress);
        this.extendCurve(data as Progress);
        break;
      case 'queue':
        this.places = placesOf(data as Queue);
        break;
      case 'deleted':
        this.forget((data as { id: string }).id);
        break;
    }
  }

  /** A restarted service may count frames from a lower number again: whatever it says now is newer. */
  private startOver(): void {
    this.serverGeneration++;
    this.jobs = this.jobs.map((job) => ({ ...job, frame_seq: 0 }));
    void this.reload();
  }

  private extendCurve(progress: Progress | Job): void {
    const curve = this.curves[progress.id];
    if (!curve && isEnded(progress.state)) return;
    const next = withPoint(curve ?? [], progress);
    if (next !== curve) this.curves = { ...this.curves, [progress.id]: next };
  }
}

export const board = new Board();
