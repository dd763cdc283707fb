/** The scenes that have a lesson: those of the gallery, and one's own. */
import { listScenes } from '../api/client';
import { pictureOf } from '../api/learn';
import type { UploadedScene } from '../api/types';
import { board } from '../state/board.svelte';

/** As the service has it: beyond, a scene has no lesson. */
const MOST_BYTES = 256 * 2 ** 20;

export interface LessonScene {
  /** In the gallery, or the id of an upload. */
  name: string;
  title: string;
  width: number;
  height: number;
  thumbnail: string;
}

const hasLesson = ({ requirements }: UploadedScene): boolean =>
  requirements != null && Object.keys(requirements.media).length === 0 && requirements.memory_bytes <= MOST_BYTES;

class LessonScenes {
  private uploads = $state.raw<readonly UploadedScene[]>([]);
  readonly gallery: LessonScene[] = $derived(board.gallery.filter((entry) => entry.has_lesson));
  readonly own: LessonScene[] = $derived(
    this.uploads.filter(hasLesson).map(({ id, name, width, height }) => ({ name: id, title: name, width, height, thumbnail: pictureOf(id) })),
  );
  readonly all: LessonScene[] = $derived([...this.gallery, ...this.own]);
  readonly areSomeLeftOut: boolean = $derived(board.gallery.length > this.gallery.length);
  readonly hasUploads: boolean = $derived(this.uploads.length > 0);

  async read(signal: AbortSignal): Promise<void> {
    try {
      this.uploads = await listScenes(signal);
    } catch {
      // The gallery is there all the same.
    }
  }
}

export const scenes = new LessonScenes();
