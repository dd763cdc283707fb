/** The Learn view's texts: a table for each language. The browser's language is the one at first; the choice is kept. */
import type { Technique } from '../../api/types';
import { en, type Words } from './en';
import { it } from './it';

export const LANGUAGES = { en: 'English', it: 'Italiano' } as const;
export type Code = keyof typeof LANGUAGES;

/** What a lesson waits for. */
export type Doing = { what: 'map' } | { what: 'refining' } | { what: 'sampling'; technique: Technique };

const TABLES: Record<Code, Words> = { en, it };
const KEY = 'fredholm.language';

function firstChoice(): Code {
  const known = (tag: string | null | undefined): Code | undefined =>
    (Object.keys(LANGUAGES) as Code[]).find((code) => tag?.toLowerCase().split('-')[0] === code);
  let kept: string | null = null;
  try {
    kept = localStorage.getItem(KEY);
  } catch {
    // Storage may be forbidden.
  }
  return known(kept) ?? navigator.languages.map(known).find((code) => code !== undefined) ?? 'en';
}

class Language {
  code = $state<Code>(firstChoice());
  readonly words: Words = $derived(TABLES[this.code]);

  choose(code: Code): void {
    this.code = code;
    try {
      localStorage.setItem(KEY, code);
    } catch {
      // Not remembered, still in force.
    }
  }
}

export const language = new Language();
