/**
 * The address after `#` as a value, both ways: `#/jobs/ID?view=error&with=OTHER`, `#/learn/SCENE?chapter=equation&x=1&y=2`.
 * Pure.
 */
import type { Layout } from '../viewer/layout';
import { type Mode, MODES } from '../viewer/scene';

/** Of the Learn view, in their order. */
export const CHAPTERS = ['equation', 'rays', 'forms', 'monte-carlo', 'pixel', 'trade', 'extremes'] as const;
export type Chapter = (typeof CHAPTERS)[number];

const LAYOUTS: readonly Layout[] = ['wipe', 'side', 'flip'];

export type Address =
  | { page: 'start' }
  | { page: 'job'; id: string; mode: Mode; exposure: number; against: string | null; layout: Layout }
  | { page: 'learn'; chapter: Chapter; scene: string | null; pixel: { x: number; y: number } | null; own: Own };

/** What a chapter keeps in the address for itself. */
export type Own = Readonly<Record<string, string>>;

export function addressOf(hash: string): Address {
  const [path, query = ''] = hash.replace(/^#\/?/, '').split('?');
  const [page, name = ''] = path.split('/');
  const asked = new URLSearchParams(query);
  if (page === 'jobs' && name !== '') {
    const exposure = Number(asked.get('ev') ?? 0);
    return {
      page: 'job',
      id: decoded(name),
      mode: MODES.find((entry) => entry.id === asked.get('view'))?.id ?? 'image',
      exposure: Number.isFinite(exposure) ? exposure : 0,
      against: asked.get('with') || null,
      layout: LAYOUTS.find((entry) => entry === asked.get('layout')) ?? 'wipe',
    };
  }
  if (page === 'learn') {
    const [x, y] = [asked.get('x'), asked.get('y')].map((text) => (text === null || text === '' ? Number.NaN : Number(text)));
    const pixel = Number.isInteger(x) && Number.isInteger(y) ? { x, y } : null;
    const own = Object.fromEntries([...asked].filter(([key]) => !['chapter', 'x', 'y'].includes(key)));
    // A link to a pixel alone is one to what its samples do.
    const usual: Chapter = name === '' ? 'equation' : 'pixel';
    const chapter = CHAPTERS.find((entry) => entry === asked.get('chapter')) ?? usual;
    return { page: 'learn', chapter, scene: name === '' ? null : decoded(name), pixel, own };
  }
  return { page: 'start' };
}

/** What differs from the usual is named, so that plain links stay short. */
export function hashOf(address: Address): string {
  const query = new URLSearchParams();
  switch (address.page) {
    case 'start':
      return '#/';
    case 'job':
      if (address.mode !== 'image') query.set('view', address.mode);
      if (address.exposure !== 0) query.set('ev', String(address.exposure));
      if (address.against !== null) {
        query.set('with', address.against);
        if (address.layout !== 'wipe') query.set('layout', address.layout);
      }
      return `#/jobs/${encodeURIComponent(address.id)}${suffix(query)}`;
    case 'learn':
      if (address.chapter !== (address.scene === null ? 'equation' : 'pixel')) query.set('chapter', address.chapter);
      if (address.scene !== null && address.pixel) {
        query.set('x', String(address.pixel.x));
        query.set('y', String(address.pixel.y));
      }
      for (const [key, value] of Object.entries(address.own)) query.set(key, value);
      return `#/learn${address.scene === null ? '' : `/${encodeURIComponent(address.scene)}`}${suffix(query)}`;
  }
}

const suffix = (query: URLSearchParams): string => (query.size > 0 ? `?${query}` : '');

/** A link cut off inside an escape is still an address, of nothing that exists. */
function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
