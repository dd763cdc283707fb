/** Hands frame bodies to the worker and gives promises back. */
import type { Frame } from './decode';
import { FrameError } from './decode';

type Answer = { id: number; frame: Frame } | { id: number; error: string };

export class FrameDecoder {
  private readonly worker = new Worker(new URL('./decode.worker.ts', import.meta.url), { type: 'module' });
  private readonly waiting = new Map<number, { resolve: (frame: Frame) => void; reject: (cause: Error) => void }>();
  private nextId = 0;

  constructor() {
    this.worker.onmessage = ({ data }: MessageEvent<Answer>) => {
      const waiter = this.waiting.get(data.id);
      this.waiting.delete(data.id);
      if ('frame' in data) waiter?.resolve(data.frame);
      else waiter?.reject(new FrameError(data.error));
    };
    this.worker.onerror = () => {
      for (const waiter of this.waiting.values()) waiter.reject(new FrameError('the frame decoder stopped'));
      this.waiting.clear();
    };
  }

  decode(body: ArrayBuffer): Promise<Frame> {
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, body }, [body]);
    });
  }

  dispose(): void {
    this.worker.terminate();
  }
}
