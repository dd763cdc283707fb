/** The page's end of the files' worker, which starts with the first file. */
import type { Region } from '../api/types';
import type { FromFiles, PictureInfo, ToFiles } from './messages';
import type { Metrics } from './metrics';
import { FileError, type Layer } from './raster';
import type { RegionNumbers } from './regions';

type Question = ToFiles extends infer Each ? (Each extends { job: number } ? Omit<Each, 'job'> : never) : never;

class FileDesk {
  private worker: Worker | null = null;
  private readonly waiting = new Map<number, { resolve: (value: never) => void; reject: (cause: Error) => void }>();
  private next = 0;

  /** source: a file of the user, or an address to read it from. */
  open = (key: string, source: File | string): Promise<PictureInfo> => this.ask({ kind: 'open', key, source });
  close = (key: string): Promise<void> => this.ask({ kind: 'close', key });
  body = (key: string, layer: Layer): Promise<ArrayBuffer> => this.ask({ kind: 'body', key, layer });
  compare = (key: string, reference: string): Promise<Metrics> => this.ask({ kind: 'compare', key, reference });
  region = (key: string, region: Region): Promise<RegionNumbers> => this.ask({ kind: 'region', key, region });
  pixel = (key: string, x: number, y: number): Promise<[string, number][]> => this.ask({ kind: 'pixel', key, x, y });

  private ask<T>(question: Question): Promise<T> {
    const job = this.next++;
    this.worker ??= this.hired();
    return new Promise<T>((resolve, reject) => {
      this.waiting.set(job, { resolve, reject });
      this.worker?.postMessage({ ...question, job });
    });
  }

  private hired(): Worker {
    const worker = new Worker(new URL('./files.worker.ts', import.meta.url), { type: 'module' });
    worker.onmessage = ({ data }: MessageEvent<FromFiles>) => {
      const waiter = this.waiting.get(data.job);
      this.waiting.delete(data.job);
      if ('error' in data) waiter?.reject(new FileError(data.error));
      else waiter?.resolve(data.value as never);
    };
    worker.onerror = () => {
      for (const { reject } of this.waiting.values()) reject(new FileError('the reader of files stopped: it may have run out of memory'));
      this.waiting.clear();
      this.worker = null;
    };
    return worker;
  }
}

export const fileDesk = new FileDesk();
