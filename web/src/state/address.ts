/**
 * The address after `#` as a value, both ways: `#/jobs/ID?view=error&with=OTHER`, `#/learn/SCENE?chapter=equation&x=1&y=2`.
 * Pure.
 */
import type { Layout } from '../viewer/layout';
import type { Region } from '../api/types';
import { COLOUR_MAPS, type ColourMap } from '../viewer/colourmaps';
import { type Mode, MODES, TONE_MAPS, type ToneMap } from '../viewer/scene';

/** Of the Learn view, in their order. */
export const CHAPTERS = ['equation', 'rays', 'forms', 'monte-carlo', 'pixel', 'trade', 'extremes'] as const;
export type Chapter = (typeof CHAPTERS)[number];

const LAYOUTS: readonly Layout[] = ['wipe', 'side', 'flip'];

export type Address =
  | { page: 'start' }
  | { page: 'job'; id: string; mode: Mode; exposure: number; against: string | null; layout: Layout; look?: JobLook }
  | { page: 'learn'; chapter: Chapter; scene: string | null; pixel: { x: number; y: number } | null; own: Own };

/** How a picture is looked at beyond mode and exposure; what is left out is as usual. */
export interface JobLook {
  tone?: ToneMap;
  map?: ColourMap;
  range?: readonly [number, number];
  isLog?: true;
  layer?: string;
  /** CSS pixels per image pixel, and the image point in the middle; left out: fitted. */
  zoom?: number;
  at?: { x: number; y: number };
  /** Pinned. */
  pixel?: { x: number; y: number };
  region?: Region;
}

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
      ...lookOf(asked),
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
      if (address.look) writeLook(query, address.look);
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

/** Only what can be used: a link may be cut short. */
function lookOf(asked: URLSearchParams): { look?: JobLook } {
  const numbers = (key: string, count: number, isUsable: (value: number) => boolean): number[] | null => {
    const values = (asked.get(key) ?? '').split(',').map((text) => (text === '' ? Number.NaN : Number(text)));
    return values.length === count && values.every((value) => Number.isFinite(value) && isUsable(value)) ? values : null;
  };
  const isPixel = (value: number): boolean => Number.isInteger(value) && value >= 0;
  const look: JobLook = {};
  const tone = TONE_MAPS.find((entry) => entry.id === asked.get('tone'));
  const map = COLOUR_MAPS.find((entry) => entry.id === asked.get('map'));
  const range = numbers('range', 2, () => true);
  const [zoom, at] = [numbers('zoom', 1, (value) => value > 0), numbers('at', 2, () => true)];
  const [pixel, region] = [numbers('px', 2, isPixel), numbers('region', 4, isPixel)];
  if (tone) look.tone = tone.id;
  if (map) look.map = map.id;
  if (range && range[0] < range[1]) look.range = [range[0], range[1]];
  if (asked.get('log') === '1') look.isLog = true;
  if (asked.get('layer')) look.layer = asked.get('layer')!;
  if (zoom && at) [look.zoom, look.at] = [zoom[0], { x: at[0], y: at[1] }];
  if (pixel) look.pixel = { x: pixel[0], y: pixel[1] };
  if (region && region[2] > 0 && region[3] > 0) look.region = [region[0], region[1], region[2], region[3]];
  return Object.keys(look).length > 0 ? { look } : {};
}

function writeLook(query: URLSearchParams, { tone, map, range, isLog, layer, zoom, at, pixel, region }: JobLook): void {
  const plain = (value: number): string => String(+value.toPrecision(5));
  if (layer) query.set('layer', layer);
  if (tone) query.set('tone', tone);
  if (map) query.set('map', map);
  if (range) query.set('range', range.map(plain).join());
  if (isLog) query.set('log', '1');
  if (zoom !== undefined && at) {
    query.set('zoom', plain(zoom));
    query.set('at', [at.x, at.y].map(plain).join());
  }
  if (pixel) query.set('px', `${pixel.x},${pixel.y}`);
  if (region) query.set('region', region.join());
}

const suffix = (query: URLSearchParams): string => (query.size > 0 ? `?${String(query).replaceAll('%2C', ',')}` : '');

/** A link cut off inside an escape is still an address, of nothing that exists. */
function decoded(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
