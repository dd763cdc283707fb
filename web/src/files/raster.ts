/** A picture read from a file: full planes of numbers, as the file has them. */
export interface Raster {
  width: number;
  height: number;
  /** (height · width) values per channel, row 0 at the top, in the file's order. */
  planes: ReadonlyMap<string, Float32Array>;
  /** Numbers and texts of the header. */
  attributes: Readonly<Record<string, string | number>>;
}

/** A file that is no picture, or not one that can be read here; the message is for the user. */
export class FileError extends Error {}

/** Channels that belong together: a colour, a vector, or one number. */
export interface Layer {
  /** The channels' common prefix; "" is the picture itself. */
  name: string;
  channels: readonly string[];
}

/** Of files and of what is decoded from them: more would not fit a page. */
export const MOST_VALUES = 1 << 28;

const ORDER = 'RGBYXZUVWA';

/** A picture's layers, the picture itself first. Standard errors and counts belong to it and are none of their own. */
export function layersOf(names: Iterable<string>): Layer[] {
  const groups = new Map<string, string[]>();
  for (const name of names) {
    if (isBookkeeping(name)) continue;
    const dot = name.lastIndexOf('.');
    const last = name.slice(dot + 1);
    // "depth" is a layer of one number; "R" and "albedo.R" are parts of one.
    const prefix = dot >= 0 ? name.slice(0, dot) : last.length === 1 ? '' : name;
    groups.set(prefix, [...(groups.get(prefix) ?? []), name]);
  }
  const layers = [...groups].map(([name, channels]) => ({ name, channels: inOrder(channels) }));
  return layers.sort((a, b) => Number(b.name === '') - Number(a.name === ''));
}

/** Those that a job has, by the channels that it was asked for. */
export function layersAsked(channels: readonly string[]): Layer[] {
  const parts = (name: string, letters: string): Layer => ({ name, channels: [...letters].map((letter) => `${name}.${letter}`) });
  return channels.flatMap((name): Layer[] => {
    switch (name) {
      case 'albedo':
        return [parts(name, 'RGB')];
      case 'normal':
      case 'position':
        return [parts(name, 'XYZ')];
      case 'depth':
      case 'shape_index':
        return [{ name, channels: [name] }];
      case 'stokes':
        return ['S0', 'S1', 'S2', 'S3'].map((stokes) => parts(stokes, 'RGB'));
      default:
        return [];
    }
  });
}

const isBookkeeping = (name: string): boolean => /^(stderr\.|count$|trust$|invalid$)/.test(name);

/** R, G, B, A and X, Y, Z as they are said; a file has them by the alphabet. Alpha is not shown as a colour. */
function inOrder(channels: readonly string[]): string[] {
  const place = (name: string): number => {
    const at = ORDER.indexOf(name.slice(name.lastIndexOf('.') + 1).toUpperCase());
    return at < 0 ? ORDER.length : at;
  };
  const isVector = channels.some((name) => /(^|\.)X$/i.test(name));
  const sorted = isVector ? [...channels].sort() : [...channels].sort((a, b) => place(a) - place(b));
  const withoutAlpha = sorted.filter((name) => !/(^|\.)A$/i.test(name));
  return withoutAlpha.length > 0 ? withoutAlpha : sorted;
}

/** Three planes of a layer: one number is grey, of more than three the first three are taken. */
export function threeOf(raster: Raster, layer: Layer): readonly [Float32Array, Float32Array, Float32Array] {
  const planes = layer.channels.map((name) => raster.planes.get(name)!);
  if (planes.length >= 3) return [planes[0], planes[1], planes[2]];
  return planes.length === 2 ? [planes[0], planes[1], new Float32Array(planes[0].length)] : [planes[0], planes[0], planes[0]];
}
