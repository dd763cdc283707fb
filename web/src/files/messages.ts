/** What page and files' worker say to each other. */
import type { Region } from '../api/types';
import type { Layer } from './raster';

export interface PictureInfo {
  width: number;
  height: number;
  layers: Layer[];
  attributes: Readonly<Record<string, string | number>>;
  /** It has standard errors: a picture of ours. */
  hasErrors: boolean;
}

export type ToFiles = { job: number } & (
  | { kind: 'open'; key: string; source: File | string }
  | { kind: 'close'; key: string }
  | { kind: 'body'; key: string; layer: Layer }
  | { kind: 'compare'; key: string; reference: string }
  | { kind: 'region'; key: string; region: Region }
  | { kind: 'pixel'; key: string; x: number; y: number }
);

export type FromFiles = { job: number; value: unknown } | { job: number; error: string };
