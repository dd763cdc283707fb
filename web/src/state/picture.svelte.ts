/** One job's picture as it comes in: its newest frame, what went wrong, and the service's reading of the probed pixel. */
import { untrack } from 'svelte';
import { framePath, readPixel } from '../api/client';
import { isEnded, type Job, type PixelReading } from '../api/types';
import { FramePuller } from '../frame/puller';
import { type Reading, readPixelOf } from '../frame/reading';
import { pictureCanvas } from '../viewer/canvas';
import type { HeldFrame } from '../viewer/scene';
import type { Size } from '../viewer/view';
import { board } from './board.svelte';
import { type Exact, files, isFileId, type OpenedFile } from './files.svelte';

/** Middle of the error map where a job has no error target. */
const USUAL_TARGET = 0.05;

export interface Probe {
  x: number;
  y: number;
}

export class Picture {
  id = $state<string | null>(null);
  private isMissing = $state(false);
  /** The newest frame of the job's picture. */
  private live = $state.raw<HeldFrame | null>(null);
  /** Of a layer beside the picture itself, with its name. */
  private layered = $state.raw<{ name: string; frame: HeldFrame } | null>(null);
  /** "" is the picture itself. */
  layer = $state('');
  frameArrived = $state(0);
  trouble = $state<string | null>(null);
  /** The service's reading of the probed pixel: channel-wise errors, samples, replicates, trust. */
  pixel = $state.raw<PixelReading | null>(null);

  readonly file: OpenedFile | null = $derived(files.of(this.id));
  /** The picture itself, whatever layer is shown. */
  readonly main: HeldFrame | null = $derived(this.file?.frame ?? this.live);
  /** What is drawn. */
  readonly frame: HeldFrame | null = $derived(this.layer !== '' && this.layered?.name === this.layer ? this.layered.frame : this.main);
  readonly isUnknown: boolean = $derived((isFileId(this.id) && !this.file) || this.isMissing || (this.id !== null && board.deleted.has(this.id)));
  readonly job: Job | null = $derived(board.jobs.find((job) => job.id === this.id) ?? null);
  readonly image: Size = $derived({
    width: this.job?.settings.width ?? this.main?.header.width ?? 1,
    height: this.job?.settings.height ?? this.main?.header.height ?? 1,
  });
  readonly name: string = $derived(this.job?.name ?? this.file?.name ?? '');
  /** There is something to look at, or will be. */
  readonly isOpen: boolean = $derived(this.job !== null || this.file !== null);
  readonly target: number = $derived(this.job?.target.error ?? USUAL_TARGET);
  /** Its numbers will not change any more. */
  readonly isFinal: boolean = $derived(this.file !== null || (this.job !== null && isEnded(this.job.state)));
  private readonly endedId: string | null = $derived(this.job && isEnded(this.job.state) ? this.job.id : null);

  /** When the bytes of the newest frame were there, in milliseconds since the epoch. */
  bytesArrived = 0;
  private readId: string | null = null;

  private readonly puller = new FramePuller<HeldFrame>({
    source: {
      pull: async (request, signal) => {
        const arrival = await pictureCanvas.pull(new URL(framePath(request), document.baseURI).href, signal);
        this.bytesArrived = arrival.arrivedAt;
        return arrival;
      },
      drop: (frame) => pictureCanvas.drop(frame),
    },
    onFrame: (id, frame) => {
      if (id !== this.id) return pictureCanvas.drop(frame);
      this.show(frame);
      this.frameArrived = performance.now();
      this.trouble = null;
    },
    onFailure: (_, cause) => (this.trouble = cause instanceof Error ? cause.message : String(cause)),
  });

  /** Follows `id`, and the probe; called once, inside an effect root. */
  follow(probe: () => Probe | null, wantsMaps: () => boolean): void {
    $effect(() => {
      const { id } = this;
      this.puller.select(isFileId(id) ? null : id);
      untrack(() => this.show(null));
      this.trouble = null;
      this.isMissing = false;
      if (id === null || isFileId(id)) return;
      const abort = new AbortController();
      void board.read(id, abort.signal).then((isThere) => {
        if (!abort.signal.aborted) this.isMissing = !isThere;
      });
      return () => abort.abort();
    });
    $effect(() => {
      if (board.serverGeneration > 0) this.puller.forget();
    });
    $effect(() => {
      const { job } = this;
      void board.serverGeneration;
      if (job) this.puller.announce(job.id, job.frame_seq, isEnded(job.state));
    });
    $effect(() => this.puller.wantMaps(wantsMaps()));
    $effect(() => {
      // A job that just ended has its last curve points with the service.
      const id = this.endedId;
      if (id !== null) void board.read(id, new AbortController().signal);
    });
    $effect(() => this.readPixel(probe()));
    $effect(() => this.readLayer());
  }

  /** Its numbers in full, once they are read; null where there are none yet. */
  exact(): Promise<Exact> | null {
    if (this.file) return Promise.resolve({ key: this.file.id, info: this.file.info });
    return this.job && this.job.frame_seq > 0 ? files.exactOf(this.job) : null;
  }

  private readLayer(): (() => void) | undefined {
    const { layer } = this;
    void this.file;
    void this.endedId;
    const hasPicture = this.main !== null;
    if (layer === '' || !hasPicture) {
      this.layered = null;
      return undefined;
    }
    let isCurrent = true;
    void untrack(() => this.exact())
      ?.then((exact) => files.layerOf(exact, layer))
      .then(
        (frame) => isCurrent && (this.layered = { name: layer, frame }),
        (cause: unknown) => (this.trouble = cause instanceof Error ? cause.message : String(cause)),
      );
    return () => (isCurrent = false);
  }

  readingAt(probe: Probe | null): Reading | null {
    if (!this.main || !probe) return null;
    return readPixelOf(this.main, probe.x, probe.y, this.pixel?.replicates);
  }

  private show(frame: HeldFrame | null): void {
    if (this.live) pictureCanvas.drop(this.live);
    this.live = frame;
  }

  private readPixel(probe: Probe | null): (() => void) | undefined {
    const { live: frame, id } = this;
    // A newer frame of the same pixel keeps the older reading until its own has come.
    const held = untrack(() => this.pixel);
    if (held && (held.x !== probe?.x || held.y !== probe.y || this.readId !== id)) this.pixel = null;
    this.readId = id;
    if (!probe || !frame || id === null || probe.x >= this.image.width || probe.y >= this.image.height) return undefined;
    const abort = new AbortController();
    const timer = setTimeout(() => {
      readPixel(id, probe.x, probe.y, abort.signal).then(
        (reading) => (this.pixel = reading),
        () => undefined,
      );
    }, 120);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }
}
