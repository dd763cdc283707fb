/**
 * Pulls the newest frame of the selected job: at most one request under way, stale frames are never queued, and a
 * change of selection aborts what is under way. While the link is slow it asks for 2×2 means; once it is not, or no newer
 * frame will come, for the whole of what is shown.
 */
import type { Frame } from './decode';
import { Link } from './link';

export interface FrameRequest {
  jobId: string;
  /** Sequence number of the newest frame at hand. */
  after: number;
  reduce: 1 | 2;
  /** With replicates and trust of every pixel. */
  hasMaps: boolean;
}

/** What came of a request. */
export interface Pulled<F extends Frame> {
  /** Null where there is none newer. */
  frame: F | null;
  /** The link's time alone: a decoder that has just been started does not make a slow link. */
  linkMilliseconds: number;
  /** Of those, from the first byte to the last. */
  bodyMilliseconds: number;
}

export interface FrameSource<F extends Frame> {
  pull(request: FrameRequest, signal: AbortSignal): Promise<Pulled<F>>;
  /** Takes back a frame that came too late to be shown. */
  drop(frame: F): void;
}

export interface PullerOptions<F extends Frame> {
  source: FrameSource<F>;
  onFrame: (jobId: string, frame: F) => void;
  onFailure: (jobId: string, cause: unknown) => void;
}

const RETRY_MS = 2000;

export class FramePuller<F extends Frame = Frame> {
  private jobId: string | null = null;
  private wanted = 0;
  private held = 0;
  private heldReduce = 1;
  private heldMaps = false;
  private wantsMaps = false;
  private isFinal = false;
  private readonly link = new Link();
  private abort: AbortController | null = null;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly options: PullerOptions<F>) {}

  select(jobId: string | null): void {
    if (jobId === this.jobId) return;
    this.forget();
    this.jobId = jobId;
  }

  /** Tells that `jobId` has frame `seq`; `isFinal` once no newer one will come. */
  announce(jobId: string, seq: number, isFinal: boolean): void {
    if (jobId !== this.jobId || seq <= 0) return;
    this.wanted = Math.max(this.wanted, seq);
    this.isFinal = isFinal;
    this.pullIfNeeded();
  }

  /** Whether frames are to come with maps; one held without them is asked for again. */
  wantMaps(areWanted: boolean): void {
    this.wantsMaps = areWanted;
    this.pullIfNeeded();
  }

  /** Drops what is held: after a server restart its sequence numbers mean nothing. */
  forget(): void {
    this.abort?.abort();
    this.abort = null;
    clearTimeout(this.retryTimer);
    this.wanted = 0;
    this.held = 0;
    this.heldReduce = 1;
    this.heldMaps = false;
    this.isFinal = false;
  }

  private get reduce(): 1 | 2 {
    return this.isFinal ? 1 : this.link.reduce;
  }

  private get isNeeded(): boolean {
    if (this.wanted === 0) return false;
    return this.held < this.wanted || this.heldReduce > this.reduce || (this.wantsMaps && !this.heldMaps);
  }

  private pullIfNeeded(): void {
    if (this.abort || this.jobId === null || !this.isNeeded) return;
    void this.pull(this.jobId);
  }

  private async pull(jobId: string): Promise<void> {
    const abort = new AbortController();
    this.abort = abort;
    clearTimeout(this.retryTimer);
    const reduce = this.reduce;
    const hasMaps = this.wantsMaps;
    // The newest frame held only as 2×2 means or without maps has to be asked for again.
    const after = this.held >= this.wanted ? 0 : this.held;
    try {
      const { source } = this.options;
      const { frame, linkMilliseconds, bodyMilliseconds } = await source.pull({ jobId, after, reduce, hasMaps }, abort.signal);
      if (abort.signal.aborted) {
        if (frame) source.drop(frame);
        return;
      }
      // An answer without a picture says nothing about the link.
      if (frame) this.link.note(reduce, linkMilliseconds, bodyMilliseconds);
      if (frame) {
        this.held = Math.max(this.held, frame.header.seq);
        this.heldReduce = frame.header.reduce;
        this.heldMaps = hasMaps;
        this.options.onFrame(jobId, frame);
      } else {
        this.held = Math.max(this.held, this.wanted);
        this.heldReduce = 1;
        this.heldMaps = hasMaps;
      }
      this.abort = null;
      this.pullIfNeeded();
    } catch (cause) {
      if (abort.signal.aborted) return;
      this.abort = null;
      this.options.onFailure(jobId, cause);
      this.retryTimer = setTimeout(() => this.pullIfNeeded(), RETRY_MS);
    }
  }
}
