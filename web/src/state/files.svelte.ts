/** Pictures opened from files, and the full numbers of jobs that are compared, measured or looked at layer by layer. */
import { exrPath } from '../api/client';
import { isEnded, type Job } from '../api/types';
import { fileDesk } from '../files/desk';
import type { PictureInfo } from '../files/messages';
import { pictureCanvas } from '../viewer/canvas';
import type { HeldFrame } from '../viewer/scene';

export interface OpenedFile {
  id: string;
  name: string;
  bytes: number;
  info: PictureInfo;
  frame: HeldFrame;
}

/** A picture whose numbers the files' worker holds. */
export interface Exact {
  key: string;
  info: PictureInfo;
}

const PREFIX = 'file-';
export const isFileId = (id: string | null): boolean => id?.startsWith(PREFIX) ?? false;
export const isPictureFile = (file: File): boolean => /\.(exr|hdr|pic|rgbe)$/i.test(file.name);

class Files {
  opened = $state.raw<readonly OpenedFile[]>([]);
  /** Names of what is being read. */
  reading = $state.raw<readonly string[]>([]);
  refusal = $state<string | null>(null);
  private next = 1;
  /** By job: the newest of its saved pictures that was asked for. */
  private readonly exact = new Map<string, { seq: number; isFinal: boolean; picture: Promise<Exact> }>();
  private readonly layers = new Map<string, Promise<HeldFrame>>();

  of = (id: string | null): OpenedFile | null => this.opened.find((file) => file.id === id) ?? null;

  /** Reads files; null where none of them could be. The reason of a refusal is in `refusal`. */
  async open(given: readonly File[]): Promise<OpenedFile | null> {
    this.refusal = null;
    let first: OpenedFile | null = null;
    for (const file of given) {
      this.reading = [...this.reading, file.name];
      try {
        const opened = await this.read(file);
        this.opened = [...this.opened, opened];
        first ??= opened;
      } catch (cause) {
        this.refusal = `${file.name}: ${cause instanceof Error ? cause.message : String(cause)}.`;
      } finally {
        this.reading = this.reading.filter((name) => name !== file.name);
      }
    }
    return first;
  }

  private async read(file: File): Promise<OpenedFile> {
    const id = `${PREFIX}${this.next++}`;
    const info = await fileDesk.open(id, file);
    const frame = await pictureCanvas.keep(await fileDesk.body(id, info.layers[0]));
    return { id, name: file.name, bytes: file.size, info, frame };
  }

  close(id: string): void {
    const file = this.of(id);
    if (!file) return;
    this.opened = this.opened.filter((one) => one.id !== id);
    pictureCanvas.drop(file.frame);
    this.forget(id);
  }

  /** A job's saved picture in full: read once, and again once it has ended. */
  exactOf(job: Job): Promise<Exact> {
    const isFinal = isEnded(job.state);
    const known = this.exact.get(job.id);
    if (known && (known.isFinal || !isFinal) && (isFinal ? known.seq === job.frame_seq : true)) return known.picture;
    const key = `${job.id}@${job.frame_seq}`;
    const picture = fileDesk.open(key, new URL(exrPath(job.id), document.baseURI).href).then((info) => ({ key, info }));
    this.exact.set(job.id, { seq: job.frame_seq, isFinal, picture });
    // What could not be read is asked for anew next time.
    picture.catch(() => this.exact.delete(job.id));
    void known?.picture.then(({ key: old }) => this.forget(old), () => undefined);
    return picture;
  }

  /** A running job's numbers are read anew at the next question. */
  refresh(job: Job): void {
    if (!isEnded(job.state)) this.exact.delete(job.id);
  }

  /** A layer as a frame to be drawn; made once. */
  layerOf({ key, info }: Exact, name: string): Promise<HeldFrame> {
    const layer = info.layers.find((one) => one.name === name);
    if (!layer) return Promise.reject(new Error(`the picture has no layer ${name}`));
    const id = `${key}/${name}`;
    const known = this.layers.get(id);
    if (known) return known;
    const frame = fileDesk.body(key, layer).then((body) => pictureCanvas.keep(body));
    this.layers.set(id, frame);
    frame.catch(() => this.layers.delete(id));
    return frame;
  }

  private forget(key: string): void {
    void fileDesk.close(key);
    for (const [id, frame] of this.layers) {
      if (!id.startsWith(`${key}/`)) continue;
      this.layers.delete(id);
      void frame.then((held) => pictureCanvas.drop(held), () => undefined);
    }
  }
}

export const files = new Files();
