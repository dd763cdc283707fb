/** A question to the renderer as the page holds it: its answer, that it is on its way, or why there is none. */
import { isAbort, Problem, problemOf } from '../api/problem';

const BUSY = 429;
const BUSY_MS = 2000;

export class Asked<T> {
  value = $state.raw<T | null>(null);
  trouble = $state<string | null>(null);
  isBusy = $state(false);
  /** When it was asked, on the page's clock. */
  askedAt = $state(0);
  private going = new AbortController();
  private question: ((signal: AbortSignal) => Promise<T>) | null = null;

  /** Asks, in place of whatever was asked before. keeps: the old answer stays until the new one is there. */
  async ask(question: (signal: AbortSignal) => Promise<T>, keeps = false): Promise<void> {
    this.end();
    this.question = question;
    const { signal } = (this.going = new AbortController());
    if (!keeps) this.value = null;
    this.trouble = null;
    this.isBusy = true;
    this.askedAt = performance.now();
    try {
      const answer = await patient(() => question(signal), signal);
      if (!signal.aborted) this.value = answer;
    } catch (cause) {
      if (!signal.aborted && !isAbort(cause)) this.trouble = problemOf(cause).detail;
    } finally {
      if (this.going.signal === signal) this.isBusy = false;
    }
  }

  /** Asks for turn after turn, each of which tells all that is known by then, until one is the last. */
  async turns(next: (step: number, signal: AbortSignal) => Promise<T>, isLast: (turn: T) => boolean, keeps = false): Promise<void> {
    await this.ask(async (signal) => {
      for (let step = 0; ; step++) {
        const turn = await patient(() => next(step, signal), signal);
        if (isLast(turn) || signal.aborted) return turn;
        this.value = turn;
      }
    }, keeps);
  }

  /** The same again, after trouble. */
  again(): void {
    if (this.question) void this.ask(this.question, true);
  }

  end(): void {
    this.going.abort();
    this.isBusy = false;
  }
}

/** Asks again while the renderer has too much to answer. */
export async function patient<T>(ask: () => Promise<T>, signal: AbortSignal): Promise<T> {
  for (;;) {
    try {
      return await ask();
    } catch (cause) {
      if (!(cause instanceof Problem) || cause.status !== BUSY || signal.aborted) throw cause;
      await new Promise((done) => setTimeout(done, BUSY_MS));
    }
  }
}
