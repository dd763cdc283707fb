/**
 * The page's end of the picture's canvas. The canvas is made once, with the page, so that its graphics context and
 * shaders are ready before the first picture; it moves into whatever viewer is open.
 */
import { FrameError } from '../frame/decode';
import type { Agreement, Arrival, FromWorker, HeldFrame, Painting, ToWorker } from './scene';

interface Waiter {
  resolve: (value: never) => void;
  reject: (cause: Error) => void;
}

export class PictureCanvas {
  readonly element = document.createElement('canvas');
  largestSide = Infinity;
  /** Called once it is known that nothing can be drawn here, with the reason. */
  onBlind: (reason: string) => void = () => undefined;

  private worker: Worker | null = null;
  private isStarted = false;
  private readonly waiting = new Map<number, Waiter>();
  private nextJob = 0;
  private wanted: { painting: Painting; onPainted: () => void } | null = null;
  private painting: { onPainted: () => void } | null = null;

  constructor() {
    this.element.dataset.part = 'picture';
  }

  /** Hands the canvas to the worker, which makes its graphics context. Once is enough. */
  start(): void {
    if (this.isStarted) return;
    this.isStarted = true;
    if (!('transferControlToOffscreen' in this.element)) {
      this.onBlind('This browser cannot draw beside the page');
      return;
    }
    const density = window.devicePixelRatio || 1;
    this.element.width = Math.round(window.innerWidth * density);
    this.element.height = Math.round(window.innerHeight * density);
    const canvas = this.element.transferControlToOffscreen();
    this.send({ kind: 'canvas', canvas }, [canvas]);
  }

  /** Fetches and decodes a frame, all away from the page's thread: a busy page asks, and is answered, once. */
  pull(address: string, signal: AbortSignal): Promise<Arrival> {
    return this.ask((job) => {
      this.send({ kind: 'pull', job, address });
      signal.addEventListener('abort', () => this.send({ kind: 'abort', job }), { once: true });
    });
  }

  /** Takes a frame body that was made here, from a file. */
  keep(body: ArrayBuffer): Promise<HeldFrame> {
    return this.ask((job) => this.send({ kind: 'keep', job, body }, [body]));
  }

  /** What is shown, as PNG. */
  async shoot(): Promise<Blob> {
    // What was asked for is drawn first.
    while (this.painting || this.wanted) await new Promise((resolve) => requestAnimationFrame(resolve));
    return this.ask((job) => this.send({ kind: 'shoot', job }));
  }

  agree(a: HeldFrame, b: HeldFrame): Promise<Agreement | null> {
    return this.ask((job) => this.send({ kind: 'agree', job, a: a.id, b: b.id }));
  }

  /** The frame will not be drawn again. */
  drop(frame: HeldFrame): void {
    this.send({ kind: 'drop', frame: frame.id });
  }

  /** Draws as soon as the painting before is done; of several that wait only the newest is drawn. */
  paint(painting: Painting, onPainted: () => void): void {
    this.start();
    this.wanted = { painting, onPainted };
    if (!this.painting) this.paintNext();
  }

  private paintNext(): void {
    this.painting = this.wanted;
    if (this.wanted) this.send({ kind: 'paint', painting: this.wanted.painting });
    this.wanted = null;
  }

  private take(message: FromWorker): void {
    switch (message.kind) {
      case 'ready':
        this.largestSide = message.largestSide;
        break;
      case 'blind':
        this.onBlind(message.reason);
        break;
      case 'painted':
        this.fit();
        this.painting?.onPainted();
        this.paintNext();
        break;
      case 'answer':
        this.waiterOf(message.job)?.resolve(message.value as never);
        break;
      case 'refused':
        this.waiterOf(message.job)?.reject(new FrameError(message.error));
        break;
    }
  }

  /** One canvas pixel on one device pixel: `object-fit` shows the top left corner, as much as there is room for. */
  private fit(): void {
    const density = window.devicePixelRatio || 1;
    this.element.style.width = this.element.style.height = `${100 * density}%`;
    this.element.style.transform = density === 1 ? '' : `scale(${1 / density})`;
  }

  private waiterOf(job: number): Waiter | undefined {
    const waiter = this.waiting.get(job);
    this.waiting.delete(job);
    return waiter;
  }

  private ask<T>(send: (job: number) => void): Promise<T> {
    const job = this.nextJob++;
    return new Promise<T>((resolve, reject) => {
      this.waiting.set(job, { resolve, reject });
      send(job);
    });
  }

  private send(message: ToWorker, transfer: Transferable[] = []): void {
    this.worker ??= this.hired();
    this.worker.postMessage(message, transfer);
  }

  private hired(): Worker {
    const worker = new Worker(new URL('./canvas.worker.ts', import.meta.url), { type: 'module' });
    worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.take(data);
    worker.onerror = () => {
      for (const waiter of this.waiting.values()) waiter.reject(new FrameError('the frame decoder stopped'));
      this.waiting.clear();
    };
    return worker;
  }
}

export const pictureCanvas = new PictureCanvas();
