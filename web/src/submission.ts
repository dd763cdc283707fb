/** The New render form as a value: what was typed, what is wrong with it, what is sent. */
import type { GalleryScene, Job, Region, SensorChoice, SeriesSubmission, SettingsRequest, Submission, Target, Technique, UploadedScene } from './api/types';

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
  /** How sure to be of the error, and of how many pixels: what the API was asked for, kept. */
  confidence: number | null;
  share: number | null;
}

/** Settings that the form has no field for: they are kept from the job that is asked for again. */
type Carried = Omit<SettingsRequest, 'width' | 'height' | 'seed' | 'max_depth' | 'technique' | 'adaptive' | 'channels' | 'sensor' | 'camera' | 'parameters'>;

/** Where the sensor is and looks, as typed: "x, y, z", degrees; empty is as the scene has it. */
export type CameraDraft = Record<'origin' | 'target' | 'up' | 'fov', string>;

/** Fields as typed; empty means "the scene's own" or "no such target". */
export interface Draft extends TargetDraft {
  choice: SceneChoice | null;
  width: string;
  height: string;
  maxDepth: string;
  technique: Technique;
  isAdaptive: boolean;
  seed: string;
  /** Width over height that both sides keep while one is typed; null: they are free. */
  proportions: number | null;
  /** By name or number; null: the scene's first. */
  sensor: string | number | null;
  /** One picture of each sensor instead. */
  hasAllSensors: boolean;
  camera: CameraDraft;
  /** Values for the scene's parameters, as typed; empty is the scene's own; several, parted by semicolons, are a picture each. */
  parameters: Record<string, string>;
  /** What else to say of each pixel. */
  channels: ChannelName[];
  carried: Carried;
  priority: number;
}

export type DraftErrors = Partial<Record<`camera.${keyof CameraDraft}` | 'scene' | 'target' | 'error' | 'seconds' | 'spp' | 'region' | 'width' | 'height' | 'max_depth' | 'seed', string>>;

export const TECHNIQUES: readonly { id: Technique; label: string; teaches: string }[] = [
  { id: 'mis', label: 'MIS: both, weighted', teaches: 'BSDF and emitter sampling, weighted. Rarely beaten.' },
  { id: 'emitter', label: 'Emitter sampling', teaches: 'Area form: points on the lights. Strong for small lights, blind to mirrors.' },
  { id: 'bsdf', label: 'BSDF sampling', teaches: 'Directions the surface likes. Strong for gloss, noisy for small lights.' },
  { id: 'cosine', label: 'Cosine hemisphere', teaches: 'Cosine-weighted hemisphere. Good for matt surfaces and large lights.' },
  { id: 'uniform', label: 'Uniform hemisphere', teaches: 'Every direction alike: the baseline the others are measured against.' },
];

export type ChannelName = NonNullable<SettingsRequest['channels']>[number];

export const CHANNELS: readonly { id: ChannelName; label: string }[] = [
  { id: 'albedo', label: 'Albedo' },
  { id: 'normal', label: 'Normal' },
  { id: 'depth', label: 'Depth' },
  { id: 'position', label: 'Position' },
  { id: 'shape_index', label: 'Shape index' },
  { id: 'stokes', label: 'Polarisation (Stokes)' },
];

const OWN_CAMERA: CameraDraft = { origin: '', target: '', up: '', fov: '' };

export function freshDraft(): Draft {
  return {
    choice: null,
    hasError: true, errorPercent: '5',
    hasSeconds: true, seconds: '60',
    hasSpp: false, spp: '256',
    region: '', confidence: null, share: null,
    width: '', height: '', proportions: 1,
    maxDepth: '', technique: 'mis', isAdaptive: true, seed: '0',
    sensor: null, hasAllSensors: false, camera: OWN_CAMERA, parameters: {}, channels: [], carried: {}, priority: 0,
  }; // prettier-ignore
}

/** The form filled with what an earlier job asked for. */
export function draftFrom(job: Job, choice: SceneChoice | null): Draft {
  const { target, settings, priority = 0 } = job;
  const text = (value: number | null | undefined, otherwise: string): string => (value === null || value === undefined ? otherwise : String(value));
  const { width, height, seed, max_depth, technique, adaptive, sensor = null, camera = null, parameters = {}, channels = [], ...others } = settings;
  return {
    choice,
    hasError: !!target.error,
    errorPercent: text(target.error ? +(target.error * 100).toPrecision(6) : null, '5'),
    hasSeconds: !!target.seconds,
    seconds: text(target.seconds, '60'),
    hasSpp: !!target.spp,
    spp: text(target.spp, '256'),
    region: regionAsTyped(asRegion(target.region)),
    confidence: target.confidence ?? null,
    share: target.share ?? null,
    width: text(width, ''),
    height: text(height, ''),
    proportions: width && height ? width / height : 1,
    maxDepth: text(max_depth, ''),
    technique,
    isAdaptive: adaptive ?? true,
    seed: text(seed, '0'),
    sensor,
    hasAllSensors: false,
    camera: camera === null ? OWN_CAMERA : {
      origin: camera.origin?.join(', ') ?? '', target: camera.target?.join(', ') ?? '', up: camera.up?.join(', ') ?? '', fov: text(camera.fov, ''),
    }, // prettier-ignore
    parameters,
    channels: channels as ChannelName[],
    carried: present(others) as Carried,
    priority,
  };
}

/** What is kept though the form does not show it, in a few words. */
export function carriedInWords({ carried, priority }: Draft): string {
  const usual = (key: string, value: unknown): boolean => (Array.isArray(value) ? value.length === 0 : key === 'colour' && value === 'auto');
  const parts = Object.entries(carried)
    .filter(([key, value]) => !usual(key, value))
    .map(([key, value]) => `${key.replaceAll('_', ' ')} ${Array.isArray(value) ? value.join(', ') : String(value)}`);
  return [...parts, ...(priority ? [`priority ${priority}`] : [])].join('; ');
}

/** The draft for another scene: its size is the scene's own, in its own proportions. */
export function withScene(draft: Draft, choice: SceneChoice): Draft {
  const { width, height } = choice.scene;
  return { ...draft, choice, sensor: null, hasAllSensors: false, camera: OWN_CAMERA, parameters: {}, width: '', height: '', region: '', proportions: draft.proportions === null ? null : width / height };
}

/** The draft for another sensor of its scene, whose image has a size of its own. */
export function withSensor(draft: Draft, { index, width, height }: SensorChoice): Draft {
  if (!draft.choice) return draft;
  const seen = { ...draft.choice, scene: { ...draft.choice.scene, width, height } } as SceneChoice;
  return { ...withScene(draft, seen), parameters: draft.parameters, sensor: index };
}

type Side = 'width' | 'height';

/** A side typed; the other one follows where proportions are kept and both are filled in. */
export function resized(draft: Draft, side: Side, value: string): Draft {
  const other: Side = side === 'width' ? 'height' : 'width';
  const typed = { ...draft, [side]: value };
  if (draft.proportions === null || draft[other] === '') return typed;
  return { ...typed, [other]: value.trim() === '' ? '' : (inProportion(side, value, draft.proportions) ?? draft[other]) };
}

/** Both sides as they will be sent: an empty one follows from the other; both empty: the scene's own. */
export function sizeOf(draft: Draft): Record<Side, string> {
  const { width, height } = draft;
  // An empty side that is free is the scene's own.
  if (draft.proportions === null || (width === '') === (height === '')) return { width, height };
  const proportions = draft.choice ? draft.choice.scene.width / draft.choice.scene.height : draft.proportions;
  return width === ''
    ? { width: inProportion('height', height, proportions) ?? '', height }
    : { width, height: inProportion('width', width, proportions) ?? '' };
}

/** Keeps the proportions that the fields have now, or sets both sides free. */
export function withProportions(draft: Draft, areKept: boolean): Draft {
  if (!areKept) return { ...draft, proportions: null };
  const { width, height } = sizeOf(draft);
  const typed = Number(width) / Number(height);
  const own = draft.choice ? draft.choice.scene.width / draft.choice.scene.height : 1;
  return { ...draft, proportions: typed > 0 && Number.isFinite(typed) ? typed : own };
}

function inProportion(side: Side, value: string, proportions: number): string | null {
  const length = Number(value);
  if (!(length > 0) || !Number.isFinite(length)) return null;
  return String(Math.max(1, Math.round(side === 'width' ? length / proportions : length * proportions)));
}

/** Without what was left to the service. */
const present = (record: object): object =>
  Object.fromEntries(Object.entries(record).filter(([, value]) => value !== null && value !== undefined));

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
    confidence: target.confidence ?? null,
    share: target.share ?? null,
  };
}

export function targetOf(draft: TargetDraft): Target {
  const region = draft.hasError ? regionOf(draft.region) : null;
  return {
    ...(region && { region }),
    ...(draft.hasError && { error: +(Number(draft.errorPercent) / 100).toPrecision(8) }),
    ...(draft.hasError && draft.confidence !== null && { confidence: draft.confidence }),
    ...(draft.hasError && draft.share !== null && { share: draft.share }),
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
  const { width, height } = sizeOf(draft);
  if (width !== '') errors.width = outside(width, 1, 16_384, 'px', true);
  if (height !== '') errors.height = outside(height, 1, 16_384, 'px', true);
  if (draft.maxDepth !== '') errors.max_depth = outside(draft.maxDepth, -1, 1_000_000, '', true);
  for (const part of ['origin', 'target', 'up'] as const) {
    if (vectorOf(draft.camera[part]) === undefined) errors[`camera.${part}`] = 'Three numbers: x, y, z.';
  }
  const fov = Number(draft.camera.fov);
  if (draft.camera.fov !== '' && !(fov > 0 && fov < 180)) errors['camera.fov'] = 'Above 0 and below 180 degrees.';
  if (draft.seed !== '') errors.seed = outside(draft.seed, 0, 4_294_967_295, '', true);
  return without(errors);
}

export function submissionOf(draft: Draft): Submission {
  if (!draft.choice) throw new Error('no scene chosen');
  const { choice } = draft;
  const { width, height } = sizeOf(draft);
  return {
    scene: choice.kind === 'gallery' ? { gallery: choice.scene.name } : { id: choice.scene.id },
    target: targetOf(draft),
    settings: {
      technique: draft.technique,
      ...(!draft.isAdaptive && { adaptive: false }),
      ...(draft.channels.length > 0 && { channels: draft.channels }),
      ...(width !== '' && { width: Number(width) }),
      ...(height !== '' && { height: Number(height) }),
      ...(draft.maxDepth !== '' && { max_depth: Number(draft.maxDepth) }),
      ...(draft.seed !== '' && { seed: Number(draft.seed) }),
      ...(draft.sensor !== null && !draft.hasAllSensors && { sensor: draft.sensor }),
      ...cameraOf(draft.camera),
      ...parametersOf(draft.parameters),
      ...draft.carried,
    },
    ...(draft.priority !== 0 && { priority: draft.priority }),
  };
}

/** Three numbers typed; null for none, undefined for anything else. */
function vectorOf(text: string): number[] | null | undefined {
  if (text.trim() === '') return null;
  const numbers = text.trim().split(/[\s,;]+/).map(Number);
  return numbers.length === 3 && numbers.every(Number.isFinite) ? numbers : undefined;
}

function cameraOf({ origin, target, up, fov }: CameraDraft): Pick<SettingsRequest, 'camera'> {
  const camera = { ...vector('origin', origin), ...vector('target', target), ...vector('up', up), ...(fov !== '' && { fov: Number(fov) }) };
  return Object.keys(camera).length > 0 ? { camera } : {};
}

function vector<K extends string>(name: K, text: string): Partial<Record<K, number[]>> {
  const numbers = vectorOf(text);
  return numbers ? ({ [name]: numbers } as Partial<Record<K, number[]>>) : {};
}

/** What was typed for each parameter that has any: several values are parted by semicolons. */
const valuesOf = (typed: Record<string, string>): [string, string[]][] =>
  Object.entries(typed)
    .map(([name, text]): [string, string[]] => [name, text.split(';').map((value) => value.trim()).filter((value) => value !== '')]) // prettier-ignore
    .filter(([, values]) => values.length > 0);

function parametersOf(typed: Record<string, string>): Pick<SettingsRequest, 'parameters'> {
  const given = valuesOf(typed).filter(([, values]) => values.length === 1);
  return given.length > 0 ? { parameters: Object.fromEntries(given.map(([name, [value]]) => [name, value])) } : {};
}

/** All combinations of the values of parameters that have several. */
function sweepOf(typed: Record<string, string>): Record<string, string>[] {
  const several = valuesOf(typed).filter(([, values]) => values.length > 1);
  return several.reduce<Record<string, string>[]>((sets, [name, values]) => sets.flatMap((set) => values.map((value) => ({ ...set, [name]: value }))), [{}]);
}

/** How many pictures a draft asks for. */
export const picturesOf = (draft: Draft, sensors: number): number => sweepOf(draft.parameters).length * (draft.hasAllSensors ? sensors : 1);

/** What is sent for several pictures; null where the draft asks for one. */
export function seriesOf(draft: Draft): SeriesSubmission | null {
  const sweep = sweepOf(draft.parameters);
  if (sweep.length < 2 && !draft.hasAllSensors) return null;
  return { ...submissionOf(draft), ...(draft.hasAllSensors && { sensors: 'all' as const }), ...(sweep.length > 1 && { sweep }) };
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
