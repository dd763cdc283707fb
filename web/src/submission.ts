/** The New render form as a value: what was typed, what is wrong with it, what is sent. */
import type { GalleryScene, Job, Region, Submission, Target, Technique, UploadedScene } from './api/types';

export type SceneChoice =
  | { kind: 'gallery'; scene: GalleryScene }
  | { kind: 'upload'; scene: UploadedScene };

/** When to stop, as typed. */
export interface TargetDraft {
  hasError: boolean;
  errorPercent: string;
  hasSeconds: boolean;
  seconds: string;
  hasSpp: boolean;
  spp: string;
  /** "x, y, width, height"; empty: the whole picture. */
  region: string;
}

/** Fields as typed; empty means "the scene's own" or "no such target". */
export interface Draft extends TargetDraft {
  choice: SceneChoice | null;
  width: string;
  height: string;
  maxDepth: string;
  technique: Technique;
  isAdaptive: boolean;
  seed: string;
}

export type DraftErrors = Partial<Record<'scene' | 'target' | 'error' | 'seconds' | 'spp' | 'region' | 'width' | 'height' | 'max_depth' | 'seed', string>>;

export const TECHNIQUES: readonly { id: Technique; label: string; teaches: string }[] = [
  { id: 'mis', label: 'MIS: both, weighted', teaches: 'BSDF and emitter sampling, weighted. Rarely beaten.' },
  { id: 'emitter', label: 'Emitter sampling', teaches: 'Area form: points on the lights. Strong for small lights, blind to mirrors.' },
  { id: 'bsdf', label: 'BSDF sampling', teaches: 'Directions the surface likes. Strong for gloss, noisy for small lights.' },
  { id: 'cosine', label: 'Cosine hemisphere', teaches: 'Cosine-weighted hemisphere. Good for matt surfaces and large lights.' },
  { id: 'uniform', label: 'Uniform hemisphere', teaches: 'Every direction alike: the baseline the others are measured against.' },
];

export function freshDraft(): Draft {
  return {
    choice: null,
    hasError: true, errorPercent: '5',
    hasSeconds: true, seconds: '60',
    hasSpp: false, spp: '256',
    region: '',
    width: '', height: '',
    maxDepth: '', technique: 'mis', isAdaptive: true, seed: '0',
  }; // prettier-ignore
}

/** The form filled with what an earlier job asked for. */
export function draftFrom(job: Job, choice: SceneChoice | null): Draft {
  const { target, settings } = job;
  const text = (value: number | null | undefined, otherwise: string): string =>
    value === null || value === undefined ? otherwise : String(+value.toPrecision(6));
  return {
    choice,
    hasError: !!target.error,
    errorPercent: text(target.error ? target.error * 100 : null, '5'),
    hasSeconds: !!target.seconds,
    seconds: text(target.seconds, '60'),
    hasSpp: !!target.spp,
    spp: text(target.spp, '256'),
    region: regionAsTyped(asRegion(target.region)),
    width: text(settings.width, ''),
    height: text(settings.height, ''),
    maxDepth: settings.max_depth !== null && settings.max_depth > 0 ? text(settings.max_depth, '') : '',
    technique: settings.technique,
    isAdaptive: settings.adaptive ?? true,
    seed: text(settings.seed, '0'),
  };
}

/** The wire's list of four. */
export const asRegion = (list: readonly number[] | null | undefined): Region | null =>
  list?.length === 4 ? [list[0], list[1], list[2], list[3]] : null;

export const regionAsTyped = (region: Region | null): string => region?.join(', ') ?? '';

/** The region typed, null for the whole picture. */
function regionOf(text: string): Region | null | undefined {
  if (text.trim() === '') return null;
  const numbers = text.trim().split(/[\s,;×x]+/).map(Number);
  const isFine = numbers.length === 4 && numbers.every((value) => Number.isInteger(value) && value >= 0) && numbers[2] > 0 && numbers[3] > 0;
  return isFine ? (numbers as Region) : undefined;
}

/** What a job that has ended may be continued to: half the error (a target that was missed first), twice the time or samples. */
export function furtherTarget(job: Job, region: Region | null): TargetDraft {
  const { target, error, seconds, spp } = job;
  const text = (value: number): string => String(+value.toPrecision(2));
  const reached = error ?? target.error ?? 0.05;
  const missed = target.error && reached > target.error ? target.error : 0;
  return {
    hasError: !!target.error || (!target.seconds && !target.spp),
    errorPercent: text(Math.max(50 * reached, 100 * missed, 0.01)),
    hasSeconds: !!target.seconds,
    seconds: text(Math.max(4 * seconds, 2 * (target.seconds ?? 0), 1)),
    hasSpp: !!target.spp && !target.error,
    spp: String(Math.ceil(4 * Math.max(spp, target.spp ?? 0, 1))),
    region: regionAsTyped(region ?? asRegion(target.region)),
  };
}

export function targetOf(draft: TargetDraft): Target {
  const region = draft.hasError ? regionOf(draft.region) : null;
  return {
    ...(region && { region }),
    ...(draft.hasError && { error: +(Number(draft.errorPercent) / 100).toPrecision(8) }),
    ...(draft.hasSeconds && { seconds: Number(draft.seconds) }),
    ...(draft.hasSpp && { spp: Number(draft.spp) }),
  };
}

export function targetErrorsOf(draft: TargetDraft): DraftErrors {
  const errors: DraftErrors = {};
  if (!draft.hasError && !draft.hasSeconds && !draft.hasSpp) errors.target = 'Give at least one target.';
  if (draft.hasError) errors.error = outside(draft.errorPercent, 0.01, 100, '%', false);
  if (draft.hasSeconds) errors.seconds = outside(draft.seconds, 0.1, 604_800, 's', false);
  if (draft.hasSpp) errors.spp = outside(draft.spp, 2, 1_048_576, '', true);
  if (draft.hasError && regionOf(draft.region) === undefined) errors.region = 'Four whole numbers: x, y, width, height.';
  return without(errors);
}

export function errorsOf(draft: Draft): DraftErrors {
  const errors: DraftErrors = targetErrorsOf(draft);
  if (!draft.choice) errors.scene = 'Pick a scene or drop a file.';
  if (draft.width !== '') errors.width = outside(draft.width, 1, 16_384, 'px', true);
  if (draft.height !== '') errors.height = outside(draft.height, 1, 16_384, 'px', true);
  if (draft.maxDepth !== '') errors.max_depth = outside(draft.maxDepth, 1, 1024, '', true);
  if (draft.seed !== '') errors.seed = outside(draft.seed, 0, 4_294_967_295, '', true);
  return without(errors);
}

export function submissionOf(draft: Draft): Submission {
  if (!draft.choice) throw new Error('no scene chosen');
  const { choice } = draft;
  return {
    scene: choice.kind === 'gallery' ? { gallery: choice.scene.name } : { id: choice.scene.id },
    target: targetOf(draft),
    settings: {
      technique: draft.technique,
      ...(!draft.isAdaptive && { adaptive: false }),
      ...(draft.width !== '' && { width: Number(draft.width) }),
      ...(draft.height !== '' && { height: Number(draft.height) }),
      ...(draft.maxDepth !== '' && { max_depth: Number(draft.maxDepth) }),
      ...(draft.seed !== '' && { seed: Number(draft.seed) }),
    },
  };
}

const without = (errors: DraftErrors): DraftErrors =>
  Object.fromEntries(Object.entries(errors).filter(([, message]) => message !== undefined));

function outside(text: string, low: number, high: number, unit: string, isWhole: boolean): string | undefined {
  const value = Number(text);
  const shownUnit = unit ? ` ${unit}` : '';
  if (text.trim() === '' || !Number.isFinite(value)) return 'Type a number.';
  if (isWhole && !Number.isInteger(value)) return 'Type a whole number.';
  if (value < low || value > high) return `From ${low} to ${high}${shownUnit}.`;
  return undefined;
}
