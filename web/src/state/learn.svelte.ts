/** What the Learn view shows: a chapter, and a pixel of a scene. */
import type { Address, Chapter, Own } from './address';

export interface Pixel {
  x: number;
  y: number;
}

type LearnAddress = Extract<Address, { page: 'learn' }>;

class Learn {
  chapter = $state<Chapter>('equation');
  sceneName = $state<string | null>(null);
  pixel = $state.raw<Pixel | null>(null);
  /** What the chapter keeps in the address for itself. */
  own = $state.raw<Own>({});

  readonly address: LearnAddress = $derived({
    page: 'learn', chapter: this.chapter, scene: this.sceneName, pixel: this.pixel, own: this.own,
  }); // prettier-ignore

  open({ chapter, scene, pixel, own }: LearnAddress): void {
    this.chapter = chapter;
    // A link to a chapter alone keeps the scene that one looks at.
    if (scene !== null) this.choose(scene, pixel);
    this.own = own;
  }

  choose(scene: string, pixel: Pixel | null): void {
    const isSame = scene === this.sceneName && pixel?.x === this.pixel?.x && pixel?.y === this.pixel?.y;
    if (isSame) return;
    this.sceneName = scene;
    this.pixel = pixel;
  }

  /** Writes down something of the chapter's own; null takes it away. */
  keep(changes: Record<string, string | null>): void {
    const own = { ...this.own, ...changes };
    this.own = Object.fromEntries(Object.entries(own).filter((entry): entry is [string, string] => entry[1] !== null));
  }
}

export const learn = new Learn();
