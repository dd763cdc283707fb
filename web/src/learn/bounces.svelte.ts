/** A pixel's light by the number of reflections: asked in parts that merge, beside samples of its own to compare with. */
import { bounces, runningEstimate } from '../api/learn';
import type { Bounces } from '../api/messages';
import type { Pixel } from '../state/learn.svelte';
import { Asked } from './asked.svelte';
import { half95, merged, type Step, variance } from './moments';

const FIRST = 4096;
const MOST_AT_ONCE = 65_536;
/** Samples of other numbers, independent of those of the series. */
const OTHERS_FROM = 1 << 23;

export interface Series {
  terms: readonly Step[];
  more: Step;
  reflected: Step;
  total: Step;
  /** The pixel by other samples. */
  others: Step;
}

export const joined = (a: Bounces, b: Bounces): Bounces => ({
  terms: a.terms.map((term, i) => merged(term, b.terms[i])),
  more: merged(a.more, b.more),
  reflected: merged(a.reflected, b.reflected),
  total: merged(a.total, b.total),
});

/** Whether two 95 % intervals have anything in common. */
export const doMeet = (a: Step, b: Step): boolean =>
  Math.abs(a.mean - b.mean) <= half(a) + half(b) + 1e-6 * Math.max(Math.abs(a.mean), Math.abs(b.mean));

const half = (step: Step): number => (variance(step) > 0 ? half95(step) : 0);

class Bounced extends Asked<Series> {
  async open(scene: string, pixel: Pixel): Promise<void> {
    await this.ask((signal) => this.upTo(FIRST, scene, pixel, null, signal));
  }

  async more(scene: string, pixel: Pixel): Promise<void> {
    const known = this.value;
    if (known) await this.ask((signal) => this.upTo(4 * known.total.n, scene, pixel, known, signal), true);
  }

  private async upTo(wanted: number, scene: string, { x, y }: Pixel, known: Series | null, signal: AbortSignal): Promise<Series> {
    let all: Bounces | null = known && { ...known, terms: [...known.terms] };
    let others = known?.others ?? null;
    for (;;) {
      const first = all?.total.n ?? 0;
      const count = Math.min(wanted - first, MOST_AT_ONCE);
      if (count <= 0) break;
      const part = await bounces(scene, x, y, first, count, signal);
      const beside = (await runningEstimate(scene, x, y, 'mis', OTHERS_FROM + first, count, signal)).at(-1);
      all = all ? joined(all, part) : part;
      if (beside) others = others ? merged(others, beside) : beside;
    }
    if (!all || !others) throw new Error('the renderer gave no samples');
    return { ...all, others };
  }
}

export const bounced = new Bounced();
