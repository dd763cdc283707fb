/** Wire types of the service under `api/`. Errors are relative (0.031 = 3.1 %), times are seconds of rendering. */

export type JobState = 'queued' | 'running' | 'paused' | 'succeeded' | 'failed' | 'cancelled';
export type StoppedBy = 'error' | 'seconds' | 'spp' | 'cancelled';
export type Technique = 'uniform' | 'cosine' | 'bsdf' | 'emitter' | 'mis';

/** x, y, width, height in image pixels. */
export type Region = [number, number, number, number];

export interface Target {
  error?: number | null;
  seconds?: number | null;
  spp?: number | null;
  region?: Region | null;
}

export interface Settings {
  width: number | null;
  height: number | null;
  seed: number | null;
  max_depth: number | null;
  technique: Technique | null;
}

export interface Forecast {
  seconds_left: number | null;
  low: number | null;
  high: number | null;
}

export interface Cause {
  title: string;
  detail: string;
  hint: string | null;
}

export interface CurvePoint {
  seconds: number;
  spp: number;
  error: number | null;
}

/** What changes while a job renders. */
export interface Progress {
  id: string;
  state: JobState;
  error: number | null;
  spp: number;
  samples: number;
  seconds: number;
  frame_seq: number;
  forecast: Forecast | null;
  share_within: number | null;
  share_trusted: number | null;
  invalid: number;
}

export interface SceneReference {
  gallery?: string | null;
  id?: string | null;
  name?: string | null;
}

export interface Job extends Progress {
  name: string;
  scene: SceneReference;
  target: Target;
  settings: Settings;
  created_at: string;
  started_at: string | null;
  finished_at: string | null;
  stopped_by: StoppedBy | null;
  queue_position: number | null;
  cause: Cause | null;
  warnings: string[];
  curve?: CurvePoint[];
}

export interface GalleryScene {
  name: string;
  title: string;
  teaches: string;
  width: number;
  height: number;
  thumbnail: string;
}

export interface UploadedScene {
  id: string;
  name: string;
  width: number;
  height: number;
  digest: string;
  warnings: string[];
}

export interface Submission {
  scene: { gallery: string } | { id: string };
  target: Target;
  settings: Partial<Settings>;
}

export interface PixelReading {
  x: number;
  y: number;
  value: (number | null)[];
  standard_error: (number | null)[];
  luminance: number | null;
  interval: (number | null)[] | null;
  samples: number;
  replicates: number;
  trusted: boolean;
}

export interface FieldError {
  field: string;
  message: string;
}

export const isEnded = (state: JobState): boolean =>
  state === 'succeeded' || state === 'failed' || state === 'cancelled';
