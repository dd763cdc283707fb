/** Written by `python -m service.typescript` from the service's OpenAPI document; do not edit. */

/** A pixel's luminance by the number of reflections. All moments are of the same samples, and parts merge. */
export interface Bounces {
  /** after 0 reflections: emitted; after 1: lit by lights; after 2, … */
  terms: RunningMoments[];
  /** after more reflections than there are terms */
  more: RunningMoments;
  /** all but what is emitted */
  reflected: RunningMoments;
  total: RunningMoments;
}

/** What differs from the sensor as the scene has it; null: nothing. */
export interface Camera {
  origin?: number[] | null;
  target?: number[] | null;
  up?: number[] | null;
  fov?: number | null;
}

/** Where a perspective or thinlens sensor stands and looks, in the scene's units; null is as the scene has it. */
export interface CameraRequest {
  /** x, y, z; alone it leaves the direction of the view */
  origin?: number[] | null;
  /** x, y, z of a point that it looks at */
  target?: number[] | null;
  /** direction that is up in the picture */
  up?: number[] | null;
  /** degrees, along the sensor's fov_axis */
  fov?: number | null;
}

/** Why a job failed, and what to try. */
export interface Cause {
  title: string;
  detail: string;
  hint: string;
}

/** A job that has ended is to go on, with a new target. */
export interface ContinueRequest {
  target: TargetRequest;
}

/**
 * One point of the convergence curve. upper: the bound of the error, which decides about a target; null where
 * there is none.
 */
export interface CurvePoint {
  seconds: number;
  spp: number;
  error: number;
  upper?: number | null;
}

/** A job is gone, with its pictures. */
export interface Deleted {
  id: string;
}

/** Directions that one technique drew at a vertex, on its map: u = φ / 2π, v = θ / polar_range. */
export interface Directions {
  u: number[];
  v: number[];
  /** emitter sampling: whether the light is visible */
  found: boolean[] | null;
  /** below the surface, where no light counts */
  lost: number;
}

/** A place on the ladder of an extreme. */
export interface ExtremeRung {
  /** how extreme: an angle, a distance, a number of samples, … */
  at: number;
  exact: number;
  /** by the naive formula in float32; null where that is no number */
  naive: number | null;
  ours: number;
  /** half-width of the 95 % interval of what was rendered; 0 where nothing is random */
  half: number;
  /** of the ladder */
  places: number;
}

/** One field that was refused. */
export interface FieldError {
  field: string;
  message: string;
}

/** What a pixel's centre sees, in the scene's units, and where each technique sends its samples from there. */
export interface FirstVertex {
  /** of the scene's picture */
  width: number;
  height: number;
  is_hit: boolean;
  position: number[];
  normal: number[];
  distance: number;
  /** luminance that the surface itself sends to the camera */
  emitted: number;
  /** how the surface scatters */
  lobes: string[];
  /** false: mirror or clear glass, one direction alone counts */
  is_smooth: boolean;
  passes_light: boolean;
  map_width: number;
  map_height: number;
  /** radians of θ from the normal: π/2, or π where light passes */
  polar_range: number;
  /** direction towards the camera, on the map */
  camera_u: number;
  camera_v: number;
  directions: Record<string, Directions>;
}

/** Render time still needed to reach the error target, with its interval. */
export interface Forecast {
  seconds_left: number | null;
  low: number | null;
  high: number | null;
}

/** JSON header of a frame body: see the description of the frame's address for the layout. */
export interface FrameHeader {
  seq: number;
  /** of the planes, after reduction */
  width: number;
  height: number;
  channels: ("R" | "G" | "B" | "SE" | "N")[];
  spp_min: number;
  spp_max: number;
  spp_mean: number;
  replicates_min: number;
  replicates_max: number;
  replicate_size: number;
  seconds: number;
  /** a power of two; half = value * scale */
  scale: number;
  /** 2: each pixel is the mean of 2x2 */
  reduce: 1 | 2;
  layout: "byteplanes-half";
  rounded: boolean;
  /** some pixels without samples show their neighbour's value */
  filled: boolean;
  /** finite values too large for the frame, shown as the largest */
  clamped: number;
}

/** A built-in scene. */
export interface GalleryScene {
  name: string;
  title: string;
  teaches: string;
  width: number;
  height: number;
  /** relative address of a PNG */
  thumbnail: string;
  /** whether the Learn view knows it: not where there are participating media */
  has_lesson: boolean;
}

/** The server answers. */
export interface Health {
  status: "ok";
}

/** First event of every stream: a new server id means that the server was started again. */
export interface Hello {
  server: string;
  last_event_id: number;
}

/**
 * What to know before believing a picture. invalid: samples that were not finite; untrusted: share of pixels.
 *
 * needs_samples: samples per pixel from which error bars can be believed, where most pixels have fewer. mixed:
 * versions and kinds of device that rendered it, where there are several.
 */
export interface ImageHealth {
  status: "good" | "uncertain" | "degraded";
  invalid: number;
  invalid_pixels: number;
  empty_pixels: number;
  untrusted: number;
  needs_samples?: number | null;
  mixed?: string[];
  cannot_see: string[];
  warnings: string[];
  /** light that samples hardly ever meet, in sentences */
  hidden?: string[];
}

/** Whether p is a density with which f may be sampled. */
export interface IntegralConditions {
  /** ∫ p as it was given; p is divided by it. Null where it is not finite */
  mass: number | null;
  is_positive: boolean;
  /** where p is below zero, or no number */
  negative_at: number | null;
  /** share of ∫ |f| where p is zero: no point ever sees it */
  unseen: number;
}

/** f and p at places x; null where they are no numbers. */
export interface IntegralCurve {
  x: number[];
  f: (number | null)[];
  p: (number | null)[];
}

/** An integral of one dimension from n points. Null is what a single point cannot tell. */
export interface IntegralEstimate {
  value: number;
  n: number;
  /** V, of one point */
  variance: number | null;
  /** √(V/n) */
  standard_error: number | null;
  /** of the 95 % interval */
  low: number | null;
  high: number | null;
  /** by quadrature */
  truth: number;
  /** how far off that may be */
  truth_error: number;
  conditions: IntegralConditions;
  curve: IntegralCurve;
  points: IntegralCurve;
}

/** Estimates of many runs: values[run][i] is from counts[i] points. */
export interface IntegralRuns {
  counts: number[];
  values: number[][];
  truth: number;
}

/** One job. error: relative (0.031 = 3.1 %); seconds: of rendering; frame_seq 0: no frame yet. */
export interface Job {
  id: string;
  name: string;
  scene: SceneName;
  state: State;
  target: Target;
  settings: Settings;
  priority: number;
  created_at: string;
  started_at: string | null;
  finished_at: string | null;
  error: number | null;
  spp: number;
  samples: number;
  seconds: number;
  frame_seq: number;
  stopped_by: "error" | "seconds" | "spp" | "cancelled" | null;
  /** 1 = next; null unless queued */
  queue_position: number | null;
  /** estimated; null unless queued, or while it cannot be told */
  expected_start: string | null;
  /** what keeps it from going on, such as room on disk */
  waits_for?: string | null;
  forecast: Forecast | null;
  share_within: number | null;
  share_trusted: number | null;
  invalid: number;
  /** what the error is below, with the target's confidence */
  error_upper?: number | null;
  /** why the error is null, where there is a picture */
  error_unknown?: string | null;
  /** samples in a replicate; null before the first picture */
  replicate_size?: number | null;
  health?: ImageHealth | null;
  cause: Cause | null;
  warnings: string[];
  /** the same for jobs that were queued together */
  series?: string | null;
}

/** One job with its convergence curve. */
export interface JobDetail {
  id: string;
  name: string;
  scene: SceneName;
  state: State;
  target: Target;
  settings: Settings;
  priority: number;
  created_at: string;
  started_at: string | null;
  finished_at: string | null;
  error: number | null;
  spp: number;
  samples: number;
  seconds: number;
  frame_seq: number;
  stopped_by: "error" | "seconds" | "spp" | "cancelled" | null;
  /** 1 = next; null unless queued */
  queue_position: number | null;
  /** estimated; null unless queued, or while it cannot be told */
  expected_start: string | null;
  /** what keeps it from going on, such as room on disk */
  waits_for?: string | null;
  forecast: Forecast | null;
  share_within: number | null;
  share_trusted: number | null;
  invalid: number;
  /** what the error is below, with the target's confidence */
  error_upper?: number | null;
  /** why the error is null, where there is a picture */
  error_unknown?: string | null;
  /** samples in a replicate; null before the first picture */
  replicate_size?: number | null;
  health?: ImageHealth | null;
  cause: Cause | null;
  warnings: string[];
  /** the same for jobs that were queued together */
  series?: string | null;
  curve: CurvePoint[];
}

/**
 * Jobs, newest first. total: how many there are, those beyond this list included. unreadable: told to those who see
 * everyone's jobs, where there are any.
 */
export interface JobList {
  jobs: Job[];
  total: number;
  unreadable?: UnreadableRow[];
}

/** A picture to be rendered. */
export interface JobRequest {
  scene: SceneChoice;
  target: TargetRequest;
  settings?: SettingsRequest;
  /** among one's own jobs; higher goes first */
  priority?: number;
  /** told of each end of the job */
  webhook?: WebhookRequest | null;
}

/** What a kernel costs. low, high: 95 % interval of render_ratio, its time over the lean one's. */
export interface KernelCost {
  name: string;
  operations: number;
  compile_seconds: number;
  render_seconds: number;
  render_ratio: number;
  low: number;
  high: number;
}

/** The lean kernel of a scene and the one that has all that any scene may need; null until they are measured. */
export interface KernelTrade {
  is_done: boolean;
  /** compilations and rounds that it takes */
  steps: number;
  /** what the lean one leaves out */
  left_out: string[];
  lean: KernelCost | null;
  full: KernelCost | null;
}

/** One sample of the radiance at a pixel's centre by technique `bsdf`. */
export interface LightPath {
  number: number;
  vertices: PathVertex[];
  /** of what the vertices add */
  sum: number;
}

/** Paths from one pixel. */
export interface LightPaths {
  paths: LightPath[];
  /** whether the camera's projection is known: points have columns and rows */
  is_placed: boolean;
}

/** A point p′ on a light, seen from p. Lengths are in the scene's units, light is luminance. */
export interface LightPoint {
  /** where it lies in the picture, in pixels from its left and top edge */
  column: number | null;
  row: number | null;
  /** whether the light is a surface; skies, points and directions have no area form */
  has_area: boolean;
  /** V: nothing lies between */
  is_visible: boolean;
  distance: number | null;
  /** at p */
  cos_theta: number;
  /** at p′; not positive: the lamp shows its back */
  cos_light: number | null;
  /** G = cosθ cosθ′ / distance² */
  geometry: number | null;
  /** BSDF towards the camera */
  f: number | null;
  /** Le towards p */
  emitted: number | null;
  /** density of the point, per solid angle at p */
  pdf: number | null;
  /** the same, per area */
  pdf_area: number | null;
  /** f Le V G / pdf_area */
  estimate: number;
}

/** Points on the lights of a scene; none where no light can be sampled. */
export interface LightPoints {
  points: LightPoint[];
  /** whether the camera's projection is known: points have columns and rows */
  is_placed: boolean;
}

/** A vertex of a path. Lengths are in the scene's units, light is luminance; null where there is no such number. */
export interface PathVertex {
  /** null where the path leaves the scene */
  position: number[] | null;
  /** where it lies in the picture, in pixels from its left and top edge */
  column: number | null;
  row: number | null;
  /** the path leaves the scene */
  is_sky: boolean;
  /** from the camera, straight */
  is_seen: boolean;
  /** of the ray that comes here */
  direction: number[];
  /** from the vertex before, or from the camera's near plane */
  distance: number | null;
  /** what shines from here towards the vertex before */
  emitted: number;
  /** what the path carries when it gets here */
  throughput: number;
  /** what the vertex adds to the pixel: their product, channel by channel */
  added: number;
  /** of the next direction */
  cos_theta: number | null;
  /** density of the next direction, per solid angle */
  pdf: number | null;
  /** f·cosθ of the next direction; null for mirrors and clear glass too */
  f_cos: number | null;
}

/** Nothing happened, and the connection is well. */
export interface Ping {
  at: string;
}

/** One pixel: value and standard error of R, G, B (and Y), and the 95 % interval of luminance Y. */
export interface Pixel {
  x: number;
  y: number;
  value: (number | null)[];
  /** null where it is not known */
  standard_error: (number | null)[];
  luminance: number | null;
  /** low, high; null where the standard error is not known */
  interval: number[] | null;
  samples: number;
  replicates: number;
  trusted: boolean;
}

/** RFC 9457 problem body of every error. */
export interface Problem {
  type: string;
  title: string;
  status: number;
  detail: string;
  errors?: FieldError[] | null;
}

/** What changes while a job runs. */
export interface ProgressMessage {
  id: string;
  state: State;
  error: number | null;
  spp: number;
  samples: number;
  seconds: number;
  frame_seq: number;
  forecast: Forecast | null;
  share_within: number | null;
  share_trusted: number | null;
  invalid: number;
  /** what the error is below, with the target's confidence */
  error_upper?: number | null;
  /** why the error is null, where there is a picture */
  error_unknown?: string | null;
  /** samples in a replicate; null before the first picture */
  replicate_size?: number | null;
  health?: ImageHealth | null;
}

/** All queued jobs that one may see, next first: it replaces whatever was known of their places. */
export interface Queue {
  places: QueuePlace[];
}

/** Where a queued job stands. position: 1 = next; expected_start: estimated, null while it cannot be told. */
export interface QueuePlace {
  id: string;
  position: number;
  expected_start: string | null;
}

/** Whether jobs start at once, and if not, what is missing. */
export interface Readiness {
  status: "ready" | "starting";
  renderer: "warm" | "starting" | "down";
  not_ready: string[];
}

/** What a scene requires. A kind of plugin is counted by name; low and high bound the scene in its own units. */
export interface Requirements {
  name: string;
  digest: string;
  width: number;
  height: number;
  load_seconds: number | null;
  shapes: Record<string, number>;
  triangles: number;
  emitters: Record<string, number>;
  bsdfs: Record<string, number>;
  textures: Record<string, number>;
  texture_pixels: number;
  media: Record<string, number>;
  sensors: Record<string, number>;
  /** in the scene's order; empty for a scene taken in by an older version */
  sensor_choices?: SensorChoice[];
  /** the scene's <default> parameters: default by name, long ones cut */
  parameters?: Record<string, string>;
  /** estimated, of the loaded scene without the picture */
  memory_bytes: number;
  low: number[] | null;
  high: number[] | null;
  is_coloured: boolean;
  coloured_by: string | null;
  variant: "mono" | "rgb" | "spectral";
  /** what asks for polarised light; null: nothing does */
  polarised_by?: string | null;
  /** what the kernel has to contain */
  features: string[];
  /** as the scene asks; -1 = unlimited */
  max_depth: number;
  depth_advice: string;
  /** whether anything moves while the shutter is open */
  needs_time: boolean;
  /** what was dropped or rewritten */
  notes: string[];
  /** numerical risks, each as 'name: sentence' */
  warnings: string[];
  unsupported: string[];
}

/** Moments of the first n samples of a part. m2, m3, m4: sums of powers of the deviations from the mean. */
export interface RunningMoments {
  n: number;
  mean: number;
  m2: number;
  m3: number;
  m4: number;
  /** samples that found any light */
  lit: number;
}

/** An uploaded scene. requirements: null for a scene taken in by an older version. */
export interface Scene {
  id: string;
  name: string;
  width: number;
  height: number;
  digest: string;
  warnings: string[];
  requirements?: Requirements | null;
}

/** Which scene: one of the gallery by name, or an uploaded one by id. */
export interface SceneChoice {
  gallery?: string | null;
  id?: string | null;
}

/** The scene of a job; one of gallery and id is set. */
export interface SceneName {
  gallery: string | null;
  id: string | null;
  name: string;
}

/** A sensor of a scene; its name may be empty. width, height: of its image. */
export interface SensorChoice {
  index: number;
  name: string;
  plugin: string;
  width: number;
  height: number;
}

/** Jobs that were queued together, in order. done: how many have succeeded; ended: or failed, or were cancelled. */
export interface Series {
  id: string;
  jobs: Job[];
  done: number;
  ended: number;
}

/** Pictures of one scene that are queued together: each sensor with each set of values, to the target each. */
export interface SeriesRequest {
  scene: SceneChoice;
  target: TargetRequest;
  settings?: SettingsRequest;
  /** among one's own jobs; higher goes first */
  priority?: number;
  /** told of each end of the job */
  webhook?: WebhookRequest | null;
  /** by name or index; null: that of the settings */
  sensors?: "all" | (string | number)[] | null;
  /** values for the scene's parameters beside those of the settings, one set each */
  sweep?: (Record<string, string | number | boolean>)[];
}

/** Who asks. client null: no keys are asked for. */
export interface Session {
  client: string | null;
  role: "read" | "submit" | "admin";
  keys_required: boolean;
}

/** A key to be kept in a cookie of the browser. */
export interface SessionRequest {
  key: string;
}

/** Which estimator a job runs, resolved. max_depth null: the scene's own. */
export interface Settings {
  width: number;
  height: number;
  seed: number;
  max_depth: number | null;
  technique: "mis" | "bsdf" | "emitter" | "cosine" | "uniform";
  adaptive?: boolean;
  colour?: string;
  channels?: string[];
  /** index of the scene's sensor; null: the first, by default */
  sensor?: number | null;
  independent_pixels?: boolean | null;
  /** null: as the scene has it */
  camera?: Camera | null;
  /** of the scene, that were given */
  parameters?: Record<string, string>;
  guide?: "off" | "on";
}

/** Which estimator; what is left out comes from the scene. */
export interface SettingsRequest {
  width?: number | null;
  height?: number | null;
  seed?: number;
  /** -1 = unlimited */
  max_depth?: number | null;
  technique?: "mis" | "bsdf" | "emitter" | "cosine" | "uniform";
  /** more samples where they lower the error most */
  adaptive?: boolean;
  /** auto: the leanest that fits */
  colour?: "auto" | "mono" | "rgb" | "spectral";
  /** also in the EXR; what the scene asks for comes unnamed; stokes renders polarised light: S0.R to S3.B, and stderr. before each name */
  channels?: ("albedo" | "normal" | "depth" | "position" | "shape_index" | "alpha" | "stokes")[];
  /** which of the scene's, by name or by index from 0; null: the first */
  sensor?: string | number | null;
  /** true: each sample counts in one pixel alone; null: in all that the filter reaches */
  independent_pixels?: boolean | null;
  /** instead of where the scene puts its sensor */
  camera?: CameraRequest | null;
  /** values for the scene's <default> parameters, which its requirements list */
  parameters?: Record<string, string | number | boolean>;
  /** on: learn first where light comes from; for light that arrives by bounces */
  guide?: "off" | "on";
}

/** Where a job is. */
export type State = "queued" | "running" | "paused" | "succeeded" | "failed" | "cancelled";

/** When a job stops. */
export interface Target {
  error: number | null;
  seconds: number | null;
  spp: number | null;
  confidence?: number | null;
  share?: number | null;
  region?: number[] | null;
}

/** When to stop; the first limit reached wins. */
export interface TargetRequest {
  /** relative error, 0.02 = 2 % */
  error?: number | null;
  /** of rendering */
  seconds?: number | null;
  /** samples per pixel, in the mean */
  spp?: number | null;
  /** how sure to be of the error; 0.95 where one is given */
  confidence?: number | null;
  /** of the pixels that must be within the error, each by itself */
  share?: number | null;
  /** x, y, width, height: the pixels whose error counts */
  region?: number[] | null;
}

/** Error against time of a scene's settings, the default first: what is known by now. */
export interface Trade {
  /** of what is to be measured, what is done: 0 to 1 */
  share: number;
  is_done: boolean;
  /** the setting whose turn is next */
  at_work: string | null;
  /** of rendering that each setting gets, at the size measured */
  seconds: number;
  /** of the picture that is measured */
  width: number;
  height: number;
  /** of the scene's own picture */
  full_width: number;
  full_height: number;
  /** its pixels over those measured */
  full_size: number;
  settings: TradeSetting[];
}

/** A setting's error after some seconds, with its 95 % interval. */
export interface TradePoint {
  seconds: number;
  spp: number;
  error: number;
  low: number;
  high: number;
}

/** What one setting costs. All seconds are those of the scene's own picture; low and high bound 95 % intervals. */
export interface TradeSetting {
  name: string;
  /** what it differs in: default, technique, replicate size, sampling or depth */
  group: string;
  technique: "mis" | "bsdf" | "emitter" | "cosine" | "uniform";
  curve: TradePoint[];
  /** that it had by now */
  seconds: number;
  samples_per_second: number | null;
  /** squared error × seconds, a constant of the setting; null: not known yet */
  work: number | null;
  work_low: number | null;
  work_high: number | null;
  /** the default's time that the same error takes */
  times: number | null;
  times_low: number | null;
  times_high: number | null;
  times_to: TradeTime[];
  /** share of the light that a shallower depth leaves out */
  lost_light: number;
  /** false: most pixels' intervals cannot be believed, it may be far worse */
  is_trusted: boolean;
  /** light that this technique never finds: its error does not know of that */
  cannot_see: string[];
}

/** Seconds to a target error with their 95 % interval; null where they are not known, or there is no such time. */
export interface TradeTime {
  target: number;
  seconds: number | null;
  low: number | null;
  high: number | null;
  /** the run got there; else a forecast */
  is_measured: boolean;
}

/** A job whose row this version cannot read. */
export interface UnreadableRow {
  id: string;
  reason: string;
}

/** Who is told of a job's end, signed as Standard Webhooks has it. */
export interface WebhookRequest {
  /** https, at a public address; answers 2xx when it has heard */
  url: string;
  /** whsec_ and the base64 of 24 to 64 bytes, to sign with */
  secret: string;
}
