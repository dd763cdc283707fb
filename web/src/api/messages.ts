/** Written by `python -m service.typescript` from the service's OpenAPI document; do not edit. */

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

/** One point of the convergence curve. */
export interface CurvePoint {
  seconds: number;
  spp: number;
  error: number;
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

/** What to know before believing a picture. invalid: samples that were not finite; untrusted: share of pixels. */
export interface ImageHealth {
  status: "good" | "uncertain" | "degraded";
  invalid: number;
  invalid_pixels: number;
  empty_pixels: number;
  untrusted: number;
  cannot_see: string[];
  warnings: string[];
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
  forecast: Forecast | null;
  share_within: number | null;
  share_trusted: number | null;
  invalid: number;
  /** what the error is below, with the target's confidence */
  error_upper?: number | null;
  health?: ImageHealth | null;
  cause: Cause | null;
  warnings: string[];
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
  forecast: Forecast | null;
  share_within: number | null;
  share_trusted: number | null;
  invalid: number;
  /** what the error is below, with the target's confidence */
  error_upper?: number | null;
  health?: ImageHealth | null;
  cause: Cause | null;
  warnings: string[];
  curve: CurvePoint[];
}

/** Jobs, newest first. */
export interface JobList {
  jobs: Job[];
}

/** A picture to be rendered. */
export interface JobRequest {
  scene: SceneChoice;
  target: TargetRequest;
  settings?: SettingsRequest;
  /** among one's own jobs; higher goes first */
  priority?: number;
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
  standard_error: (number | null)[];
  luminance: number | null;
  /** low, high; null with fewer than two replicates */
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
  health?: ImageHealth | null;
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
  /** estimated, of the loaded scene without the picture */
  memory_bytes: number;
  low: number[] | null;
  high: number[] | null;
  is_coloured: boolean;
  coloured_by: string | null;
  variant: "mono" | "rgb" | "spectral";
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

/** Moments of the first n samples of a part. m2: sum of squared deviations. */
export interface RunningMoments {
  n: number;
  mean: number;
  m2: number;
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
  /** also in the EXR */
  channels?: ("albedo" | "normal" | "depth" | "position" | "shape_index")[];
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
