/**
 * One event stream for all jobs.
 *
 * EventSource reconnects by itself after a dropped socket, but after one HTTP error it is CLOSED for good:
 * then a new one is made, backing off 1, 2, 4 … 15 s with jitter. 40 s without any event opens a new one too
 * (keep-alive comments are invisible to scripts, so silence may only mean that nothing happens).
 */
export type Connection = 'connecting' | 'live' | 'lost';

export interface EventSourceLike {
  readyState: number;
  onopen: ((event: Event) => unknown) | null;
  onerror: ((event: Event) => unknown) | null;
  addEventListener(type: string, listener: (event: MessageEvent) => void): void;
  close(): void;
}

export interface StreamOptions {
  open: () => EventSourceLike;
  /** Called after every (re)connection: what was missed is read anew. */
  onConnected: () => void;
  onConnection: (state: Connection) => void;
  onEvent: (type: string, data: unknown) => void;
  random?: () => number;
}

export const EVENT_TYPES = ['hello', 'job', 'progress', 'deleted', 'queue', 'ping'] as const;
const CLOSED = 2;
const SILENCE_MS = 40_000;
const LONGEST_WAIT_MS = 15_000;

/** Wait before attempt `attempt` (0 = first retry), with up to 25 % of jitter so that pages do not return in step. */
export function retryDelay(attempt: number, random: () => number = Math.random): number {
  return Math.min(1000 * 2 ** attempt, LONGEST_WAIT_MS) * (1 + 0.25 * random());
}

export class EventStream {
  private source: EventSourceLike | null = null;
  private attempt = 0;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;
  private silenceTimer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly options: StreamOptions) {}

  /** Opens the stream; calling it on an open one does nothing. */
  start(): void {
    if (this.source || this.retryTimer !== undefined) return;
    this.connect();
  }

  stop(): void {
    clearTimeout(this.retryTimer);
    clearTimeout(this.silenceTimer);
    this.retryTimer = undefined;
    this.source?.close();
    this.source = null;
  }

  private connect(): void {
    const source = this.options.open();
    this.source = source;
    this.listenForSilence();
    source.onopen = () => {
      if (source !== this.source) return;
      this.attempt = 0;
      this.options.onConnection('live');
      this.options.onConnected();
      this.listenForSilence();
    };
    source.onerror = () => {
      if (source !== this.source) return;
      this.options.onConnection('lost');
      if (source.readyState === CLOSED) this.reconnectLater();
    };
    for (const type of EVENT_TYPES) {
      source.addEventListener(type, (event) => {
        if (source !== this.source) return;
        this.listenForSilence();
        this.options.onEvent(type, parse(event.data));
      });
    }
  }

  private reconnectLater(): void {
    this.stop();
    this.retryTimer = setTimeout(() => {
      this.retryTimer = undefined;
      this.connect();
    }, retryDelay(this.attempt++, this.options.random));
  }

  private listenForSilence(): void {
    clearTimeout(this.silenceTimer);
    this.silenceTimer = setTimeout(() => {
      this.stop();
      this.connect();
    }, SILENCE_MS);
  }
}

/** Closes the stream once the page has been hidden for `graceMs`, opens it again when it is seen. Returns its undo. */
export function pauseWhileHidden(stream: EventStream, page: Document, graceMs = 30_000): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  const onChange = (): void => {
    clearTimeout(timer);
    if (page.visibilityState === 'hidden') timer = setTimeout(() => stream.stop(), graceMs);
    else stream.start();
  };
  page.addEventListener('visibilitychange', onChange);
  return () => {
    clearTimeout(timer);
    page.removeEventListener('visibilitychange', onChange);
  };
}

function parse(data: unknown): unknown {
  if (typeof data !== 'string') return null;
  try {
    return JSON.parse(data);
  } catch {
    return null;
  }
}
