/** What this browser remembers. Storage may be forbidden; then the choice lasts as long as the page. */
import type { ToneMap } from '../viewer/scene';

export type Theme = 'dark' | 'light';
export type Well = 'black' | 'grey' | 'white';

const PREFIX = 'fredholm.';

function read<T extends string>(name: string, allowed: readonly T[], otherwise: T): T {
  try {
    const value = localStorage.getItem(PREFIX + name);
    return allowed.find((entry) => entry === value) ?? otherwise;
  } catch {
    return otherwise;
  }
}

function write(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // Not remembered, still in force.
  }
}

class Preferences {
  theme = $state<Theme>(read('theme', ['dark', 'light'], 'dark'));
  well = $state<Well>(read('well', ['black', 'grey', 'white'], 'grey'));
  tone = $state<ToneMap>(read('tone', ['srgb', 'filmic', 'reinhard'], 'srgb'));
  areSingleKeysOn = $state(read('keys', ['on', 'off'], 'on') === 'on');

  /** Writes changes through and sets the theme on the document; called once. Returns its undo. */
  keep(page: Document): () => void {
    return $effect.root(() => {
      $effect(() => {
        page.documentElement.dataset.theme = this.theme;
        write('theme', this.theme);
      });
      $effect(() => write('well', this.well));
      $effect(() => write('tone', this.tone));
      $effect(() => write('keys', this.areSingleKeysOn ? 'on' : 'off'));
    });
  }
}

export const preferences = new Preferences();
