/** Jobs that are deleted in a moment, unless that is undone: the service is asked only then. */
import { deleteJob } from '../api/client';
import { problemOf } from '../api/problem';
import type { Job } from '../api/types';
import { board } from './board.svelte';

export const UNDO_SECONDS = 10;

class Leaving {
  jobs = $state.raw<readonly Job[]>([]);
  /** Why the last one stayed. */
  refusal = $state<string | null>(null);
  /** While somebody is about to press Undo, no time passes. */
  isHeld = $state(false);
  private seconds: Record<string, number> = {};

  /** Lets time pass; and what is left when the page is left goes at once, as was asked. */
  start(window: Window): () => void {
    const timer = setInterval(() => this.pass(0.5), 500);
    const onHide = (): void => this.jobs.forEach((job) => void this.go(job, true));
    window.addEventListener('pagehide', onHide);
    return () => {
      clearInterval(timer);
      window.removeEventListener('pagehide', onHide);
    };
  }

  has(id: string): boolean {
    return this.jobs.some((job) => job.id === id);
  }

  add(job: Job): void {
    if (this.has(job.id)) return;
    this.refusal = null;
    this.seconds[job.id] = 0;
    this.jobs = [...this.jobs, job];
  }

  /** Takes the last one back, or this one. */
  undo(id = this.jobs[this.jobs.length - 1]?.id): Job | null {
    const job = this.jobs.find((one) => one.id === id) ?? null;
    this.isHeld = false; // the button that held it is gone, and tells of no leaving
    this.drop(id);
    return job;
  }

  private pass(seconds: number): void {
    if (this.isHeld) return;
    for (const job of this.jobs) if ((this.seconds[job.id] += seconds) >= UNDO_SECONDS) void this.go(job);
  }

  private async go(job: Job, isPageLeaving = false): Promise<void> {
    this.seconds[job.id] = -Infinity; // asked once
    try {
      await deleteJob(job.id, isPageLeaving);
      board.forget(job.id);
    } catch (cause) {
      this.refusal = `${job.name} is still there: ${problemOf(cause).detail}`;
    } finally {
      this.drop(job.id);
    }
  }

  private drop(id: string | undefined): void {
    this.jobs = this.jobs.filter((job) => job.id !== id);
    if (this.jobs.length === 0) this.isHeld = false;
  }
}

export const leaving = new Leaving();
