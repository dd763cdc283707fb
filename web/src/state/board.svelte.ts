/** All jobs, as the list, the event stream and the user's own requests tell them. */
import { getJob, listGallery, listJobs } from '../api/client';
import { type Connection, EventStream, pauseWhileHidden } from '../api/events';
import { isAbort, problemOf } from '../api/problem';
import { type CurvePoint, type GalleryScene, isEnded, type Job, type Progress } from '../api/types';
import { session } from './session.svelte';
import { withJob, withList, withPoint, withProgress } from './fold';

class Board {
  /** Newest first. */
  jobs = $state.raw<Job[]>([]);
  curves = $state.raw<Record<string, CurvePoint[]>>({});
  /** Ids of jobs that were deleted while this page was open. */
  deleted = $state.raw<ReadonlySet<string>>(new Set());
  gallery = $state.raw<GalleryScene[]>([]);
  connection = $state<Connection>('connecting');
  hasList = $state(false);
  /** Counts server restarts; frames of an earlier one are void. */
  serverGeneration = $state(0);
  private server: string | null = null;

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
      const jobs = await listJobs();
      this.jobs = withList(this.jobs, jobs);
      this.hasList = true;
      if (this.gallery.length === 0) this.gallery = await listGallery();
    } catch {
      // The stream's own state says that the service is away; it calls again when it is back.
    }
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
    this.jobs = withJob(this.jobs, job);
    this.extendCurve(job);
  }

  /** The job has been deleted. */
  forget(id: string): void {
    this.jobs = this.jobs.filter((job) => job.id !== id);
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
