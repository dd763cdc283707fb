/** What a picture on the screen is made of, as plain values: the page decides them, the canvas's worker draws them. */
import type { Frame } from '../frame/decode';
import type { ColourMap } from './colourmaps';
import type { Size, View } from './view';

export type ToneMap = 'srgb' | 'filmic' | 'reinhard';
export type Mode = 'image' | 'error' | 'samples' | 'trust' | 'difference' | 'truth';

export const TONE_MAPS: readonly { id: ToneMap; label: string }[] = [
  { id: 'srgb', label: 'sRGB clip' },
  { id: 'filmic', label: 'Filmic' },
  { id: 'reinhard', label: 'Reinhard' },
];

export const MODES: readonly { id: Mode; label: string }[] = [
  { id: 'image', label: 'Image' },
  { id: 'error', label: 'Error' },
  { id: 'samples', label: 'Samples' },
  { id: 'trust', label: 'Trust' },
  { id: 'difference', label: 'Difference' },
  { id: 'truth', label: 'True error' },
];

/** Modes that need a second picture of the same size. */
export const needsTwo = (mode: Mode): boolean => mode === 'difference' || mode === 'truth';

/** Standard errors at either end of the difference's colours. */
export const DIFFERENCE_RANGE = 4;

/** A frame whose texture the worker keeps under `id`. */
export interface HeldFrame extends Frame {
  id: number;
}

/** What a request for a frame brought. */
export interface Arrival {
  /** Null where there is no newer one. */
  frame: HeldFrame | null;
  /** From the request to the last byte. */
  linkMilliseconds: number;
  /** Of those, from the first byte to the last. */
  bodyMilliseconds: number;
  /** When the last byte was there, in milliseconds since the epoch: the worker's clock starts at another time. */
  arrivedAt: number;
}

/** One picture in its part of the canvas. Lengths in device pixels from the canvas's top left corner. */
export interface Pane {
  clip: { left: number; top: number; width: number; height: number };
  view: View;
  image: Size;
  frame: number | null;
  /** The frame that a difference subtracts, or that a true error takes for the truth. */
  other: number | null;
  /** Relative error in the middle of the error map. */
  target: number;
  /** Image pixels a side that are drawn as one: all panes of a comparison alike. */
  reduce: number;
}

/** Numbers shown as such: through a colour map, or each channel by itself as grey; from one end of a range to the other. */
export interface Shade {
  map: ColourMap | null;
  range: readonly [number, number];
  isLog: boolean;
}

export interface Look {
  mode: Mode;
  tone: ToneMap;
  /** Stops. */
  exposure: number;
  onlyAbove: boolean;
  /** Instead of exposure and tone map, where the mode is the image. */
  shade: Shade | null;
  /** Samples per pixel at both ends of the samples map. */
  samples: readonly [number, number];
  /** Colour around the picture: sRGB, 0…1 per channel. */
  well: readonly [number, number, number];
}

export interface Painting {
  port: Size;
  density: number;
  panes: readonly Pane[];
  look: Look;
}

/** How far two pictures agree, over the pixels that have an estimate in both. */
export interface Agreement {
  pixels: number;
  /** Share with |z| above 1.96; 5 % are expected where both estimate the same. */
  apart: number;
  /** Root mean square of z; 1 is expected. */
  rms: number;
}

export type ToWorker =
  | { kind: 'canvas'; canvas: OffscreenCanvas }
  | { kind: 'pull'; job: number; address: string }
  | { kind: 'abort'; job: number }
  | { kind: 'keep'; job: number; body: ArrayBuffer }
  | { kind: 'drop'; frame: number }
  | { kind: 'paint'; painting: Painting }
  | { kind: 'shoot'; job: number }
  | { kind: 'agree'; job: number; a: number; b: number };

export type FromWorker =
  | { kind: 'ready'; largestSide: number }
  | { kind: 'blind'; reason: string }
  | { kind: 'answer'; job: number; value: Arrival | HeldFrame | Agreement | Blob | null }
  | { kind: 'refused'; job: number; error: string }
  | { kind: 'painted' };
