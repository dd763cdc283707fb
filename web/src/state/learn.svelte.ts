/** The Learn view's choice, a scene and a pixel, and what the renderer answers about it. */
import { firstVertex, incidentMap, runningEstimate } from '../api/learn';
import { isAbort, problemOf } from '../api/problem';
import type { FirstVertex, Technique } from '../api/types';
import { decodeFrame, type Frame } from '../frame/decode';
import { extended, type Step } from '../learn/moments';

export const TECHNIQUE_ORDER: readonly Technique[] = ['mis', 'emitter', 'bsdf', 'cosine', 'uniform'];
const FIRST_SAMPLES = 4096;
const MOST_AT_ONCE = 65_536;

class Learn {
  sceneName = $state<string | null>(null);
  pixel = $state.raw<{ x: number; y: number } | null>(null);
  isWeighted = $state(false);

  vertex = $state.raw<FirstVertex | null>(null);
  map = $state.raw<Frame | null>(null);
  steps = $state.raw<Partial<Record<Technique, Step[]>>>({});
  isBusy = $state(false);
  trouble = $state<string | null>(null);
  private abort = new AbortController();

  readonly samples: number = $derived(Math.min(...TECHNIQUE_ORDER.map((technique) => this.steps[technique]?.at(-1)?.n ?? 0)));

  open(scene: string | null, pixel: { x: number; y: number } | null): void {
    const isSame = scene === this.sceneName && pixel?.x === this.pixel?.x && pixel?.y === this.pixel?.y;
    this.sceneName = scene;
    this.pixel = pixel;
    if (!isSame) void this.ask();
  }

  /** Asks anew about scene and pixel. */
  async ask(): Promise<void> {
    await this.busy(async (scene, { x, y }, signal) => {
      this.vertex = this.map = null;
      this.steps = {};
      this.vertex = await firstVertex(scene, x, y, signal);
      if (!this.vertex.is_hit) return;
      await this.askForMap(scene, x, y, 8, signal);
      for (const technique of TECHNIQUE_ORDER) await this.askForSamples(scene, x, y, technique, FIRST_SAMPLES, signal);
      await this.askForMap(scene, x, y, 64, signal);
    });
  }

  /** As many samples again, of every technique. */
  async more(): Promise<void> {
    await this.busy(async (scene, { x, y }, signal) => {
      const count = Math.min(this.samples, MOST_AT_ONCE);
      for (const technique of TECHNIQUE_ORDER) await this.askForSamples(scene, x, y, technique, count, signal);
    });
  }

  async weigh(isWeighted: boolean): Promise<void> {
    this.isWeighted = isWeighted;
    if (this.vertex?.is_hit) await this.busy((scene, { x, y }, signal) => this.askForMap(scene, x, y, 64, signal));
  }

  private async askForMap(scene: string, x: number, y: number, replicates: number, signal: AbortSignal): Promise<void> {
    this.map = decodeFrame(await incidentMap(scene, x, y, replicates, this.isWeighted, signal));
  }

  private async askForSamples(scene: string, x: number, y: number, technique: Technique, count: number, signal: AbortSignal): Promise<void> {
    const known = this.steps[technique] ?? [];
    const part = await runningEstimate(scene, x, y, technique, known.at(-1)?.n ?? 0, count, signal);
    this.steps = { ...this.steps, [technique]: extended(known, part) };
  }

  private async busy(
    work: (scene: string, pixel: { x: number; y: number }, signal: AbortSignal) => Promise<void>,
  ): Promise<void> {
    this.abort.abort();
    const abort = (this.abort = new AbortController());
    this.trouble = null;
    if (this.sceneName === null || !this.pixel) {
      this.isBusy = false;
      return;
    }
    this.isBusy = true;
    try {
      await work(this.sceneName, this.pixel, abort.signal);
    } catch (cause) {
      if (!isAbort(cause)) this.trouble = problemOf(cause).detail;
    } finally {
      if (this.abort === abort) this.isBusy = false;
    }
  }
}

export const learn = new Learn();
