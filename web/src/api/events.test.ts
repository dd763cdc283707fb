import { afterEach, beforeEach, describe, expect, it, vi } from 'vitest';
import { type EventSourceLike, EventStream, pauseWhileHidden, retryDelay } from './events';

class FakeSource implements EventSourceLike {
  readyState = 0;
  onopen: ((event: Event) => unknown) | null = null;
  onerror: ((event: Event) => unknown) | null = null;
  readonly listeners = new Map<string, (event: MessageEvent) => void>();

  addEventListener(type: string, listener: (event: MessageEvent) => void): void {
    this.listeners.set(type, listener);
  }
  close(): void {
    this.readyState = 2;
  }
  opens(): void {
    this.readyState = 1;
    this.onopen?.(new Event('open'));
  }
  fails(state: 0 | 2): void {
    this.readyState = state;
    this.onerror?.(new Event('error'));
  }
  says(type: string, data: string): void {
    this.listeners.get(type)?.(new MessageEvent(type, { data }));
  }
}

let sources: FakeSource[];
let heard: unknown[];
let states: string[];
let reloads: number;
let stream: EventStream;
const last = (): FakeSource => sources[sources.length - 1];

beforeEach(() => {
  vi.useFakeTimers();
  [sources, heard, states, reloads] = [[], [], [], 0];
  stream = new EventStream({
    open: () => {
      sources.push(new FakeSource());
      return last();
    },
    onConnected: () => reloads++,
    onConnection: (state) => states.push(state),
    onEvent: (type, data) => heard.push([type, data]),
    random: () => 0,
  });
});
afterEach(() => {
  stream.stop();
  vi.useRealTimers();
});

it('hands events on as values and reads anew on every connection', () => {
  stream.start();
  last().opens();
  last().says('progress', '{"id":"a"}');
  last().says('job', 'not json');
  expect(heard).toEqual([['progress', { id: 'a' }], ['job', null]]); // prettier-ignore
  expect(reloads).toBe(1);
});

it('takes a ping for life, and 40 s of silence for a loss', () => {
  stream.start();
  last().opens();
  for (let i = 0; i < 8; i++) {
    vi.advanceTimersByTime(15_000);
    last().says('ping', '{"at":"2026-01-01T00:00:00Z"}');
  }
  expect(sources).toHaveLength(1);
  vi.advanceTimersByTime(40_000);
  expect(sources).toHaveLength(2);
});

it('leaves a dropped socket to the browser', () => {
  stream.start();
  last().opens();
  last().fails(0);
  vi.advanceTimersByTime(20_000);
  expect(sources).toHaveLength(1);
  last().opens();
  expect(states).toEqual(['live', 'lost', 'live']);
  expect(reloads).toBe(2);
});

it('makes a new source after an HTTP error, backing off 1, 2, 4 … 15 s', () => {
  stream.start();
  for (const wait of [1000, 2000, 4000, 8000, 15_000, 15_000]) {
    const before = sources.length;
    last().fails(2);
    vi.advanceTimersByTime(wait - 1);
    expect(sources).toHaveLength(before);
    vi.advanceTimersByTime(1);
    expect(sources).toHaveLength(before + 1);
  }
  last().opens();
  last().fails(2);
  vi.advanceTimersByTime(1000);
  expect(states.at(-1)).toBe('lost');
  expect(sources).toHaveLength(8);
});

it('opens a new source after 40 s of silence, but not while events come', () => {
  stream.start();
  last().opens();
  vi.advanceTimersByTime(39_000);
  last().says('progress', '{}');
  vi.advanceTimersByTime(39_000);
  expect(sources).toHaveLength(1);
  vi.advanceTimersByTime(1000);
  expect(sources).toHaveLength(2);
  expect(sources[0].readyState).toBe(2);
});

it('ignores what a source says after it was replaced', () => {
  stream.start();
  const first = last();
  first.opens();
  vi.advanceTimersByTime(40_000);
  first.says('job', '{}');
  first.fails(2);
  expect(heard).toEqual([]);
  expect(sources).toHaveLength(2);
});

describe('a hidden page', () => {
  it('closes its stream after 30 s and opens it when seen again', () => {
    const page = new EventTarget() as unknown as { visibilityState: string } & Document;
    const show = (state: string): void => {
      Object.defineProperty(page, 'visibilityState', { value: state, configurable: true });
      page.dispatchEvent(new Event('visibilitychange'));
    };
    const undo = pauseWhileHidden(stream, page);
    stream.start();
    show('hidden');
    vi.advanceTimersByTime(29_000);
    show('visible');
    last().says('progress', '{}');
    expect(sources).toHaveLength(1);
    show('hidden');
    vi.advanceTimersByTime(30_000);
    expect(last().readyState).toBe(2);
    show('visible');
    expect(sources).toHaveLength(2);
    undo();
  });
});

it('jitter adds at most a quarter', () => {
  expect(retryDelay(0, () => 1)).toBe(1250);
  expect(retryDelay(20, () => 0)).toBe(15_000);
});
