/** Wire types under the names that the page uses. Errors are relative (0.031 = 3.1 %), times are seconds of rendering. */
import type * as wire from './messages';

export type { Cause, CurvePoint, FieldError, FirstVertex, Forecast, GalleryScene, Requirements, SensorChoice, Session } from './messages';
export type JobState = wire.State;
export type Technique = wire.Settings['technique'];
export type StoppedBy = NonNullable<wire.Job['stopped_by']>;
export type Settings = wire.Settings;
export type SettingsRequest = wire.SettingsRequest;
export type Progress = wire.ProgressMessage;
export type UploadedScene = wire.Scene;
export type PixelReading = wire.Pixel;

/** x, y, width, height in image pixels. */
export type Region = [number, number, number, number];

/** As asked for or as told: what is left out is null there. */
export type Target = wire.TargetRequest;

export interface Job extends Omit<wire.Job, 'target'> {
  target: Target;
  curve?: wire.CurvePoint[];
}

export interface Submission {
  scene: wire.SceneChoice;
  target: Target;
  settings: wire.SettingsRequest;
  priority?: number;
}

/** Several pictures of one scene, queued together. */
export interface SeriesSubmission extends Submission {
  sensors?: 'all';
  sweep?: Record<string, string>[];
}

export interface Series extends Omit<wire.Series, 'jobs'> {
  jobs: Job[];
}

export const isEnded = (state: JobState): boolean =>
  state === 'succeeded' || state === 'failed' || state === 'cancelled';
