/** What the renderer answers about the samples of one pixel. */
import { incidentMap, runningEstimate } from '../api/learn';
import { isAbort, problemOf } from '../api/problem';
import type { FirstVertex, Technique } from '../api/types';
import { decodeFrame, type Frame } from '../frame/decode';
import type { Pixel } from '../state/learn.svelte';
import { patient } from './asked.svelte';
import { extended, type Step } from './moments';
import type { Doing } from './words/words.svelte';

export const TECHNIQUE_ORDER: readonly Technique[] = ['mis', 'emitter', 'bsdf', 'cosine', 'uniform'];
const FIRST_SAMPLES = 4096;
const MOST_AT_ONCE = 65_536;
const COARSE = 8; // replicates of the map that is shown first
const FINE = 64;

class Lesson {
  private sceneName: string | null = null;
  private pixel: Pixel | null = null;
  isWeighted = $state(false);

  vertex = $state.raw<FirstVertex | null>(null);
  map = $state.raw<Frame | null>(null);
  steps = $state.raw<Partial<Record<Technique, Step[]>>>({});
  isBusy = $state(false);
  trouble = $state<string | null>(null);
  mapTrouble = $state<string | null>(null);
  /** What is being computed; null while nothing is. */
  doing = $state.raw<Doing | null>(null);
  /** When this was asked for, on the page's clock. */
  askedAt = $state(0);
  /** One for the lesson, one for the map alone: another map does not end the sampling. */
  private lesson = new AbortController();
  private mapping = new AbortController();

  readonly samples: number = $derived(Math.min(...TECHNIQUE_ORDER.map((technique) => this.steps[technique]?.at(-1)?.n ?? 0)));
  /** Of what is shown of a pixel at first, how much is there: 0…1. */
  readonly share: number = $derived.by(() => {
    const sampled = TECHNIQUE_ORDER.filter((technique) => (this.steps[technique]?.at(-1)?.n ?? 0) >= FIRST_SAMPLES).length;
    return (Number(this.vertex !== null) + Number(this.map !== null) + sampled) / (2 + TECHNIQUE_ORDER.length);
  });

  /** Begins with a pixel whose surface is known. */
  open(scene: string, pixel: Pixel, vertex: FirstVertex): void {
    if (scene === this.sceneName && pixel.x === this.pixel?.x && pixel.y === this.pixel.y && vertex === this.vertex) return;
    this.sceneName = scene;
    this.pixel = pixel;
    this.mapping.abort();
    this.vertex = vertex;
    this.map = null;
    this.mapTrouble = null;
    this.steps = {};
    void this.goOn();
  }

  /** Nothing is known of the pixel yet. */
  close(): void {
    this.mapping.abort();
    this.lesson.abort();
    this.sceneName = this.pixel = this.vertex = this.map = null;
    this.mapTrouble = this.trouble = this.doing = null;
    this.isBusy = false;
    this.steps = {};
  }

  /** Asks for whatever is not there yet: all of it at first, the rest after trouble. */
  async goOn(): Promise<void> {
    await this.busy(async (scene, pixel, signal) => {
      if (!this.vertex?.is_hit) return;
      if (!this.map) {
        this.doing = { what: 'map' };
        await this.showMap(COARSE);
      }
      await this.sampleUpTo(Math.max(this.samples, FIRST_SAMPLES), scene, pixel, signal);
      if (signal.aborted || !this.map) return;
      this.doing = { what: 'refining' };
      await this.showMap(FINE);
    });
  }

  /** As many samples again, of every technique. */
  async more(): Promise<void> {
    await this.busy((scene, pixel, signal) => {
      const most = Math.max(this.samples, ...TECHNIQUE_ORDER.map((technique) => this.steps[technique]?.at(-1)?.n ?? 0));
      return this.sampleUpTo(Math.max(2 * this.samples, most), scene, pixel, signal);
    });
  }

  async weigh(isWeighted: boolean): Promise<void> {
    this.isWeighted = isWeighted;
    if (this.vertex?.is_hit) await this.showMap(FINE);
  }

  /** Techniques that were left behind catch up. */
  private async sampleUpTo(wanted: number, scene: string, { x, y }: Pixel, signal: AbortSignal): Promise<void> {
    for (const technique of TECHNIQUE_ORDER) {
      this.doing = { what: 'sampling', technique };
      for (;;) {
        const known = this.steps[technique] ?? [];
        const first = known.at(-1)?.n ?? 0;
        const count = Math.min(wanted - first, MOST_AT_ONCE);
        if (count <= 0) break;
        const part = await patient(() => runningEstimate(scene, x, y, technique, first, count, signal), signal);
        if (part.length === 0) break;
        this.steps = { ...this.steps, [technique]: extended(known, part) };
      }
    }
  }

  /** Shows the map that is asked for now, in place of any that was asked for before. Its trouble is its own. */
  private async showMap(replicates: number): Promise<void> {
    this.mapping.abort();
    const { signal } = (this.mapping = new AbortController());
    const { sceneName, pixel, isWeighted } = this;
    if (sceneName === null || !pixel) return;
    this.mapTrouble = null;
    try {
      const body = await patient(() => incidentMap(sceneName, pixel.x, pixel.y, replicates, isWeighted, signal), signal);
      if (!signal.aborted) this.map = decodeFrame(body);
    } catch (cause) {
      if (!isAbort(cause) && !signal.aborted) this.mapTrouble = problemOf(cause).detail;
    }
  }

  private async busy(work: (scene: string, pixel: Pixel, signal: AbortSignal) => Promise<void>): Promise<void> {
    this.lesson.abort();
    const lesson = (this.lesson = new AbortController());
    this.trouble = null;
    if (this.sceneName === null || !this.pixel) {
      this.isBusy = false;
      return;
    }
    this.isBusy = true;
    this.askedAt = performance.now();
    try {
      await work(this.sceneName, this.pixel, lesson.signal);
    } catch (cause) {
      if (!isAbort(cause) && !lesson.signal.aborted) this.trouble = problemOf(cause).detail;
    } finally {
      if (this.lesson === lesson) {
        this.isBusy = false;
        this.doing = null;
      }
    }
  }
}

export const lesson = new Lesson();
