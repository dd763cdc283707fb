/** The selected job on the bench: its newest frame, how it is looked at, and the probe. */
import { fetchFrame, readPixel } from '../api/client';
import { isEnded, type Job, type PixelReading } from '../api/types';
import type { Frame } from '../frame/decode';
import { FrameDecoder } from '../frame/decoder';
import { FramePuller } from '../frame/puller';
import { type Reading, readPixelOf } from '../frame/reading';
import type { Action } from '../keys';
import { type Mode, TONE_MAPS } from '../viewer/painter';
import { centred, fitView, panned, revealing, type Size, steppedZoom, type View, zoomAbout } from '../viewer/view';
import { board } from './board.svelte';
import { preferences } from './preferences.svelte';

export const EXPOSURE_LIMIT = 12;
/** Middle of the error map where a job has no error target. */
const USUAL_TARGET = 0.05;
const PAN_STEP = 64;

class Workbench {
  selectedId = $state<string | null>(null);
  isUnknown = $state(false);
  frame = $state.raw<Frame | null>(null);
  frameArrived = $state(0);
  frameTrouble = $state<string | null>(null);

  /** Why no picture can be drawn here, where that is so; the service's PNG stands in. */
  blindReason = $state<string | null>(null);
  mode = $state<Mode>('image');
  exposure = $state(0);
  isOnlyAbove = $state(false);

  port = $state.raw<Size>({ width: 0, height: 0 });
  density = $state(1);
  isFitted = $state(true);
  private freeView = $state.raw<View>({ zoom: 1, left: 0, top: 0 });

  probe = $state.raw<{ x: number; y: number } | null>(null);
  isPinned = $state(false);
  /** The service's reading of the probed pixel: channel-wise errors, samples, replicates, trust. */
  pixel = $state.raw<PixelReading | null>(null);
  spoken = $state('');

  readonly job: Job | null = $derived(board.jobs.find((job) => job.id === this.selectedId) ?? null);
  readonly image: Size = $derived({
    width: this.job?.settings.width ?? this.frame?.header.width ?? 1,
    height: this.job?.settings.height ?? this.frame?.header.height ?? 1,
  });
  readonly view: View = $derived(this.isFitted ? fitView(this.image, this.port) : this.freeView);
  private readonly endedId: string | null = $derived(this.job && isEnded(this.job.state) ? this.job.id : null);
  readonly target: number = $derived(this.job?.target.error ?? USUAL_TARGET);
  readonly reading: Reading | null = $derived(
    this.frame && this.probe
      ? readPixelOf(this.frame, this.probe.x, this.probe.y, this.pixel?.replicates)
      : null,
  );

  private readonly decoder = new FrameDecoder();
  private readonly puller = new FramePuller({
    source: {
      pull: async (id, after, reduce, signal) => {
        const body = await fetchFrame(id, after, reduce, signal);
        return body ? await this.decoder.decode(body) : null;
      },
    },
    onFrame: (id, frame) => {
      if (id !== this.selectedId) return;
      this.frame = frame;
      this.frameArrived = performance.now();
      this.frameTrouble = null;
    },
    onFailure: (_, cause) => (this.frameTrouble = cause instanceof Error ? cause.message : String(cause)),
  });

  /** Wires selection, frames and the pixel reading together; called once. Returns its undo. */
  start(): () => void {
    return $effect.root(() => {
      $effect(() => {
        const id = this.selectedId;
        this.puller.select(id);
        this.frame = null;
        this.frameTrouble = null;
        this.pixel = null;
        this.probe = null;
        this.isPinned = false;
        this.isFitted = true;
        this.isUnknown = false;
        if (id === null) return;
        const abort = new AbortController();
        void board.read(id, abort.signal).then((isThere) => {
          if (!abort.signal.aborted) this.isUnknown = !isThere;
        });
        return () => abort.abort();
      });
      $effect(() => {
        if (board.serverGeneration === 0) return;
        this.puller.forget();
      });
      $effect(() => {
        const job = this.job;
        void board.serverGeneration;
        if (job) this.puller.announce(job.id, job.frame_seq, isEnded(job.state));
      });
      $effect(() => {
        // A job that just ended has its last curve points with the service.
        const id = this.endedId;
        if (id !== null) void board.read(id, new AbortController().signal);
      });
      $effect(() => this.readProbedPixel());
    });
  }

  private readProbedPixel(): (() => void) | undefined {
    const { probe, frame, selectedId } = this;
    if (!probe || !frame || selectedId === null) {
      this.pixel = null;
      return undefined;
    }
    const abort = new AbortController();
    const timer = setTimeout(() => {
      readPixel(selectedId, probe.x, probe.y, abort.signal).then(
        (reading) => (this.pixel = reading),
        () => undefined,
      );
    }, 120);
    return () => {
      clearTimeout(timer);
      abort.abort();
    };
  }

  moveProbe(x: number, y: number): void {
    const next = {
      x: Math.min(Math.max(x, 0), this.image.width - 1),
      y: Math.min(Math.max(y, 0), this.image.height - 1),
    };
    if (next.x === this.probe?.x && next.y === this.probe.y) return;
    this.probe = next;
    this.pixel = null;
  }

  setView(view: View): void {
    this.freeView = view;
    this.isFitted = false;
  }

  zoomTo(zoom: number, x = this.port.width / 2, y = this.port.height / 2): void {
    this.setView(zoomAbout(this.view, zoom, x, y));
  }

  pan(dx: number, dy: number): void {
    this.setView(panned(this.view, dx, dy, this.image, this.port));
  }

  setExposure(stops: number): void {
    this.exposure = Math.min(Math.max(Math.round(stops * 10) / 10, -EXPOSURE_LIMIT), EXPOSURE_LIMIT);
  }

  /** Carries out a view or probe action; false where the action is none of the bench's. */
  act(action: Action): boolean {
    switch (action) {
      case 'exposureUp': this.setExposure(this.exposure + 0.5); return true;
      case 'exposureDown': this.setExposure(this.exposure - 0.5); return true;
      case 'exposureReset': this.setExposure(0); return true;
      case 'normalise':
        if (this.frame) this.setExposure(-Math.log2(this.frame.summary.whiteLuminance));
        return true;
      case 'nextToneMap': {
        const at = TONE_MAPS.findIndex((entry) => entry.id === preferences.tone);
        preferences.tone = TONE_MAPS[(at + 1) % TONE_MAPS.length].id;
        return true;
      }
      case 'toggleError': this.mode = this.mode === 'error' ? 'image' : 'error'; return true;
      case 'onlyAbove': this.isOnlyAbove = !this.isOnlyAbove; this.mode = 'error'; return true;
      case 'fit': this.isFitted = true; return true;
      case 'actualSize': this.setView(centred(this.image, this.port, 1)); return true;
      case 'zoomIn': this.zoomTo(steppedZoom(this.view.zoom, 1)); return true;
      case 'zoomOut': this.zoomTo(steppedZoom(this.view.zoom, -1)); return true;
      case 'panLeft': this.pan(PAN_STEP, 0); return true;
      case 'panRight': this.pan(-PAN_STEP, 0); return true;
      case 'panUp': this.pan(0, PAN_STEP); return true;
      case 'panDown': this.pan(0, -PAN_STEP); return true;
      case 'probeLeft': this.stepProbe(-1, 0); return true;
      case 'probeRight': this.stepProbe(1, 0); return true;
      case 'probeUp': this.stepProbe(0, -1); return true;
      case 'probeDown': this.stepProbe(0, 1); return true;
      case 'pin': if (!this.probe) this.stepProbe(0, 0); this.isPinned = true; return true;
      case 'unpin': this.isPinned = false; return true;
      default: return false;
    }
  } // prettier-ignore

  private stepProbe(dx: number, dy: number): void {
    const from = this.probe ?? { x: Math.floor(this.image.width / 2), y: Math.floor(this.image.height / 2) };
    this.isPinned = true;
    this.moveProbe(from.x + dx, from.y + dy);
    if (this.probe && !this.isFitted) {
      const view = revealing(this.view, this.image, this.port, this.probe.x, this.probe.y);
      if (view !== this.view) this.setView(view);
    }
    this.spoken = this.describeProbe();
  }

  private describeProbe(): string {
    const { probe, reading } = this;
    if (!probe) return '';
    const where = `Pixel ${probe.x}, ${probe.y}: `;
    if (!reading) return `${where}no samples yet.`;
    if (!reading.isValid) return `${where}not a number.`;
    const value = `luminance ${reading.luminance.toPrecision(3)}`;
    if (!reading.hasEstimate) return `${where}${value}, no error estimate yet.`;
    return `${where}${value}, ${reading.isRough ? 'about ' : ''}plus or minus ${reading.half.toPrecision(2)}.`;
  }
}

export const workbench = new Workbench();
