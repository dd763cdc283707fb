"""Wire types: what the API says and hears.

The page's types are generated from these; change them with care.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, SecretStr, model_validator

from renderer.camera import Camera as View
from renderer.errors import SettingsError
from renderer.scene.parameters import LONGEST_VALUE
from service.states import State
from service.store.records import JobRecord, Progress, SceneRecord

Technique = Literal["mis", "bsdf", "emitter", "cosine", "uniform"]
StoppedBy = Literal["error", "seconds", "spp", "cancelled"]
Side = Annotated[int, Field(ge=1, le=16384)]
MOST_PARAMETERS = 100  # that one job gives values for


class _Request(BaseModel):
    # A misspelt field is told, not ignored; true is not 1, and "4" is not 4.
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)


class SceneChoice(_Request):
    """Which scene: one of the gallery by name, or an uploaded one by id."""

    gallery: str | None = Field(default=None, max_length=100)
    id: str | None = Field(default=None, pattern="^[0-9a-zA-Z_-]{1,64}$")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.gallery is None) == (self.id is None):
            raise ValueError("name exactly one scene: gallery (a name) or id (of an uploaded scene)")
        return self


class TargetRequest(_Request):
    """When to stop; the first limit reached wins."""

    error: float | None = Field(default=None, ge=1e-6, le=10, description="relative error, 0.02 = 2 %")
    seconds: float | None = Field(default=None, ge=1e-3, le=1e8, description="of rendering")
    spp: int | None = Field(default=None, ge=1, le=2**31, description="samples per pixel, in the mean")
    confidence: float | None = Field(
        default=None, ge=0.5, le=0.9999, description="how sure to be of the error; 0.95 where one is given"
    )
    share: float | None = Field(
        default=None, ge=0.01, le=0.9999, description="of the pixels that must be within the error, each by itself"
    )
    region: list[int] | None = Field(
        default=None, min_length=4, max_length=4, description="x, y, width, height: the pixels whose error counts"
    )

    @model_validator(mode="after")
    def _at_least_one(self) -> Self:
        if self.error is None and self.seconds is None and self.spp is None:
            raise ValueError("the target is empty; give at least one of error, seconds or spp")
        if self.error is None and (self.confidence, self.share, self.region) != (None, None, None):
            raise ValueError("confidence, share and region are about an error; give one")
        if self.region is not None and (min(self.region[:2]) < 0 or min(self.region[2:]) < 1):
            raise ValueError("region is x, y, width, height in pixels; x and y from 0, width and height from 1")
        return self


Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Value = Annotated[str, Field(max_length=LONGEST_VALUE)] | float | int | bool


class CameraRequest(_Request):
    """Where a perspective or thinlens sensor stands and looks, in the scene's units; null is as the scene has it."""

    origin: Vector | None = Field(default=None, description="x, y, z; alone it leaves the direction of the view")
    target: Vector | None = Field(default=None, description="x, y, z of a point that it looks at")
    up: Vector | None = Field(default=None, description="direction that is up in the picture")
    fov: float | None = Field(default=None, gt=0, lt=180, description="degrees, along the sensor's fov_axis")

    @model_validator(mode="after")
    def _can_be(self) -> Self:
        try:
            View.of(self.model_dump())
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return self


class SettingsRequest(_Request):
    """Which estimator; what is left out comes from the scene."""

    width: Side | None = None
    height: Side | None = None
    seed: int = Field(default=0, ge=0, le=2**63 - 1)
    max_depth: int | None = Field(default=None, ge=-1, le=1_000_000, description="-1 = unlimited")
    technique: Technique = "mis"
    adaptive: bool = Field(default=True, description="more samples where they lower the error most")
    colour: Literal["auto", "mono", "rgb", "spectral"] = Field(
        default="auto", description="auto: the leanest that fits"
    )
    channels: list[Literal["albedo", "normal", "depth", "position", "shape_index", "alpha", "stokes"]] = Field(
        default_factory=list,
        max_length=7,
        description="also in the EXR; what the scene asks for comes unnamed; stokes renders polarised light: S0.R to "
        "S3.B, and stderr. before each name",
    )
    sensor: Annotated[str, Field(max_length=200)] | Annotated[int, Field(ge=0, le=999_999)] | None = Field(
        default=None, description="which of the scene's, by name or by index from 0; null: the first"
    )
    independent_pixels: bool | None = Field(
        default=None, description="true: each sample counts in one pixel alone; null: in all that the filter reaches"
    )
    camera: CameraRequest | None = Field(default=None, description="instead of where the scene puts its sensor")
    parameters: dict[str, Value] = Field(
        default_factory=dict,
        max_length=MOST_PARAMETERS,
        description="values for the scene's <default> parameters, which its requirements list",
    )
    guide: Literal["off", "on"] = Field(
        default="off", description="on: learn first where light comes from; for light that arrives by bounces"
    )


class WebhookRequest(_Request):
    """Who is told of a job's end, signed as Standard Webhooks has it."""

    url: str = Field(max_length=2000, description="https, at a public address; answers 2xx when it has heard")
    secret: SecretStr = Field(max_length=200, description="whsec_ and the base64 of 24 to 64 bytes, to sign with")


class JobRequest(_Request):
    """A picture to be rendered."""

    scene: SceneChoice
    target: TargetRequest
    settings: SettingsRequest = Field(default_factory=SettingsRequest)
    priority: int = Field(default=0, ge=-9, le=9, description="among one's own jobs; higher goes first")
    webhook: WebhookRequest | None = Field(default=None, description="told of each end of the job")


class SeriesRequest(JobRequest):
    """Pictures of one scene that are queued together: each sensor with each set of values, to the target each."""

    sensors: Literal["all"] | list[str | int] | None = Field(
        default=None, description="by name or index; null: that of the settings"
    )
    sweep: list[dict[str, Value]] = Field(
        default_factory=list, description="values for the scene's parameters beside those of the settings, one set each"
    )


class ContinueRequest(_Request):
    """A job that has ended is to go on, with a new target."""

    target: TargetRequest


class SceneName(BaseModel):
    """The scene of a job; one of gallery and id is set."""

    gallery: str | None
    id: str | None
    name: str


class Target(BaseModel):
    """When a job stops."""

    error: float | None
    seconds: float | None
    spp: int | None
    confidence: float | None = None
    share: float | None = None
    region: list[int] | None = None


class Camera(BaseModel):
    """What differs from the sensor as the scene has it; null: nothing."""

    origin: list[float] | None = None
    target: list[float] | None = None
    up: list[float] | None = None
    fov: float | None = None


class Settings(BaseModel):
    """Which estimator a job runs, resolved. max_depth null: the scene's own."""

    width: int
    height: int
    seed: int
    max_depth: int | None
    technique: Technique
    adaptive: bool = True
    colour: str = "auto"
    channels: list[str] = Field(default_factory=list)
    sensor: int | None = Field(default=None, description="index of the scene's sensor; null: the first, by default")
    independent_pixels: bool | None = None
    camera: Camera | None = Field(default=None, description="null: as the scene has it")
    parameters: dict[str, str] = Field(default_factory=dict, description="of the scene, that were given")
    guide: Literal["off", "on"] = "off"


class Forecast(BaseModel):
    """Render time still needed to reach the error target, with its interval."""

    seconds_left: float | None
    low: float | None
    high: float | None


class Cause(BaseModel):
    """Why a job failed, and what to try."""

    title: str
    detail: str
    hint: str


class ImageHealth(BaseModel):
    """What to know before believing a picture. invalid: samples that were not finite; untrusted: share of pixels.

    needs_samples: samples per pixel from which error bars can be believed, where most pixels have fewer. mixed:
    versions and kinds of device that rendered it, where there are several.
    """

    status: Literal["good", "uncertain", "degraded"]
    invalid: int
    invalid_pixels: int
    empty_pixels: int
    untrusted: float
    needs_samples: int | None = None
    mixed: list[str] = Field(default_factory=list)
    cannot_see: list[str]
    warnings: list[str]
    hidden: list[str] = Field(default_factory=list, description="light that samples hardly ever meet, in sentences")


class ProgressMessage(BaseModel):
    """What changes while a job runs."""

    id: str
    state: State
    error: float | None
    spp: float
    samples: int
    seconds: float
    frame_seq: int
    forecast: Forecast | None
    share_within: float | None
    share_trusted: float | None
    invalid: int
    error_upper: float | None = Field(default=None, description="what the error is below, with the target's confidence")
    error_unknown: str | None = Field(default=None, description="why the error is null, where there is a picture")
    replicate_size: int | None = Field(
        default=None, description="samples in a replicate; null before the first picture"
    )
    health: ImageHealth | None = None

    @classmethod
    def of(cls, job: JobRecord, progress: Progress) -> Self:
        """The progress of a job."""
        return cls.model_validate({"id": job.id, "state": job.state, **_progress_fields(progress)})


class Job(BaseModel):
    """One job. error: relative (0.031 = 3.1 %); seconds: of rendering; frame_seq 0: no frame yet."""

    id: str
    name: str
    scene: SceneName
    state: State
    target: Target
    settings: Settings
    priority: int
    created_at: str
    started_at: str | None
    finished_at: str | None
    error: float | None
    spp: float
    samples: int
    seconds: float
    frame_seq: int
    stopped_by: StoppedBy | None
    queue_position: int | None = Field(description="1 = next; null unless queued")
    expected_start: str | None = Field(description="estimated; null unless queued, or while it cannot be told")
    waits_for: str | None = Field(default=None, description="what keeps it from going on, such as room on disk")
    forecast: Forecast | None
    share_within: float | None
    share_trusted: float | None
    invalid: int
    error_upper: float | None = Field(default=None, description="what the error is below, with the target's confidence")
    error_unknown: str | None = Field(default=None, description="why the error is null, where there is a picture")
    replicate_size: int | None = Field(
        default=None, description="samples in a replicate; null before the first picture"
    )
    health: ImageHealth | None = None
    cause: Cause | None
    warnings: list[str]
    series: str | None = Field(default=None, description="the same for jobs that were queued together")

    @classmethod
    def of(
        cls,
        job: JobRecord,
        *,
        queue_position: int | None = None,
        expected_start: str | None = None,
        waits_for: str | None = None,
    ) -> Self:
        """The message for a stored job."""
        is_queued = job.state is State.QUEUED
        return cls.model_validate(
            {
                **{name: getattr(job, name) for name in _COPIED},
                **_progress_fields(job.progress),
                "scene": {
                    "gallery": job.scene_ref if job.scene_kind == "gallery" else None,
                    "id": job.scene_ref if job.scene_kind == "upload" else None,
                    "name": job.scene_name,
                },
                "curve": list(job.curve),
                "queue_position": queue_position if is_queued else None,
                "expected_start": expected_start if is_queued else None,
                "waits_for": waits_for,
                "warnings": [*job.losses, *job.warnings],
            }
        )


_COPIED = (
    *("id", "name", "state", "target", "settings", "priority", "created_at", "started_at", "finished_at"),
    *("stopped_by", "cause", "series"),
)


def _progress_fields(progress: Progress) -> dict[str, Any]:
    return {name: getattr(progress, name) for name in Progress.__dataclass_fields__}


class CurvePoint(BaseModel):
    """One point of the convergence curve. upper: the bound of the error, which decides about a target; null where
    there is none.
    """

    seconds: float
    spp: float
    error: float
    upper: float | None = None


class JobDetail(Job):
    """One job with its convergence curve."""

    curve: list[CurvePoint]


class UnreadableRow(BaseModel):
    """A job whose row this version cannot read."""

    id: str
    reason: str


class JobList(BaseModel):
    """Jobs, newest first. total: how many there are, those beyond this list included. unreadable: told to those who see
    everyone's jobs, where there are any.
    """

    jobs: list[Job]
    total: int
    unreadable: list[UnreadableRow] = Field(default_factory=list)


class Series(BaseModel):
    """Jobs that were queued together, in order. done: how many have succeeded; ended: or failed, or were cancelled."""

    id: str
    jobs: list[Job]
    done: int
    ended: int


class QueuePlace(BaseModel):
    """Where a queued job stands. position: 1 = next; expected_start: estimated, null while it cannot be told."""

    id: str
    position: int
    expected_start: str | None


class Queue(BaseModel):
    """All queued jobs that one may see, next first: it replaces whatever was known of their places."""

    places: list[QueuePlace]


class GalleryScene(BaseModel):
    """A built-in scene."""

    name: str
    title: str
    teaches: str
    width: int
    height: int
    thumbnail: str = Field(description="relative address of a PNG")
    has_lesson: bool = Field(description="whether the Learn view knows it: not where there are participating media")


class SensorChoice(BaseModel):
    """A sensor of a scene; its name may be empty. width, height: of its image."""

    index: int
    name: str
    plugin: str
    width: int
    height: int


class Requirements(BaseModel):
    """What a scene requires. A kind of plugin is counted by name; low and high bound the scene in its own units."""

    name: str
    digest: str
    width: int
    height: int
    load_seconds: float | None
    shapes: dict[str, int]
    triangles: int
    emitters: dict[str, int]
    bsdfs: dict[str, int]
    textures: dict[str, int]
    texture_pixels: int
    media: dict[str, int]
    sensors: dict[str, int]
    sensor_choices: list[SensorChoice] = Field(
        default_factory=list, description="in the scene's order; empty for a scene taken in by an older version"
    )
    parameters: dict[str, str] = Field(
        default_factory=dict, description="the scene's <default> parameters: default by name, long ones cut"
    )
    memory_bytes: int = Field(description="estimated, of the loaded scene without the picture")
    low: list[float] | None
    high: list[float] | None
    is_coloured: bool
    coloured_by: str | None
    variant: Literal["mono", "rgb", "spectral"]
    polarised_by: str | None = Field(default=None, description="what asks for polarised light; null: nothing does")
    features: list[str] = Field(description="what the kernel has to contain")
    max_depth: int = Field(description="as the scene asks; -1 = unlimited")
    depth_advice: str
    needs_time: bool = Field(description="whether anything moves while the shutter is open")
    notes: list[str] = Field(description="what was dropped or rewritten")
    warnings: list[str] = Field(description="numerical risks, each as 'name: sentence'")
    unsupported: list[str]


class Scene(BaseModel):
    """An uploaded scene. requirements: null for a scene taken in by an older version."""

    id: str
    name: str
    width: int
    height: int
    digest: str
    warnings: list[str]
    requirements: Requirements | None = None

    @classmethod
    def of(cls, scene: SceneRecord, requirements: dict[str, Any] | None = None) -> Self:
        """The message for a stored scene."""
        kept = {name: getattr(scene, name) for name in cls.model_fields if name != "requirements"}
        return cls.model_validate({**kept, "requirements": requirements})


class Pixel(BaseModel):
    """One pixel: value and standard error of R, G, B (and Y), and the 95 % interval of luminance Y."""

    x: int
    y: int
    value: list[float | None] = Field(min_length=3, max_length=3)
    standard_error: list[float | None] = Field(min_length=4, max_length=4, description="null where it is not known")
    luminance: float | None
    interval: list[float] | None = Field(description="low, high; null where the standard error is not known")
    samples: int
    replicates: int
    trusted: bool


class Directions(BaseModel):
    """Directions that one technique drew at a vertex, on its map: u = φ / 2π, v = θ / polar_range."""

    u: list[float]
    v: list[float]
    found: list[bool] | None = Field(description="emitter sampling: whether the light is visible")
    lost: int = Field(description="below the surface, where no light counts")


class FirstVertex(BaseModel):
    """What a pixel's centre sees, in the scene's units, and where each technique sends its samples from there."""

    width: int = Field(description="of the scene's picture")
    height: int
    is_hit: bool
    position: list[float]
    normal: list[float]
    distance: float
    emitted: float = Field(description="luminance that the surface itself sends to the camera")
    lobes: list[str] = Field(description="how the surface scatters")
    is_smooth: bool = Field(description="false: mirror or clear glass, one direction alone counts")
    passes_light: bool
    map_width: int
    map_height: int
    polar_range: float = Field(description="radians of θ from the normal: π/2, or π where light passes")
    camera_u: float = Field(description="direction towards the camera, on the map")
    camera_v: float
    directions: dict[str, Directions]


class RunningMoments(BaseModel):
    """Moments of the first n samples of a part. m2, m3, m4: sums of powers of the deviations from the mean."""

    n: int
    mean: float
    m2: float
    m3: float
    m4: float
    lit: int = Field(description="samples that found any light")


class Bounces(BaseModel):
    """A pixel's luminance by the number of reflections. All moments are of the same samples, and parts merge."""

    terms: list[RunningMoments] = Field(description="after 0 reflections: emitted; after 1: lit by lights; after 2, …")
    more: RunningMoments = Field(description="after more reflections than there are terms")
    reflected: RunningMoments = Field(description="all but what is emitted")
    total: RunningMoments


class PathVertex(BaseModel):
    """A vertex of a path. Lengths are in the scene's units, light is luminance; null where there is no such number."""

    position: list[float] | None = Field(description="null where the path leaves the scene")
    column: float | None = Field(description="where it lies in the picture, in pixels from its left and top edge")
    row: float | None
    is_sky: bool = Field(description="the path leaves the scene")
    is_seen: bool = Field(description="from the camera, straight")
    direction: list[float] = Field(description="of the ray that comes here")
    distance: float | None = Field(description="from the vertex before, or from the camera's near plane")
    emitted: float = Field(description="what shines from here towards the vertex before")
    throughput: float = Field(description="what the path carries when it gets here")
    added: float = Field(description="what the vertex adds to the pixel: their product, channel by channel")
    cos_theta: float | None = Field(description="of the next direction")
    pdf: float | None = Field(description="density of the next direction, per solid angle")
    f_cos: float | None = Field(description="f·cosθ of the next direction; null for mirrors and clear glass too")


class LightPath(BaseModel):
    """One sample of the radiance at a pixel's centre by technique `bsdf`."""

    number: int
    vertices: list[PathVertex]
    sum: float = Field(description="of what the vertices add")


class LightPaths(BaseModel):
    """Paths from one pixel."""

    paths: list[LightPath]
    is_placed: bool = Field(description="whether the camera's projection is known: points have columns and rows")


class LightPoint(BaseModel):
    """A point p′ on a light, seen from p. Lengths are in the scene's units, light is luminance."""

    column: float | None = Field(description="where it lies in the picture, in pixels from its left and top edge")
    row: float | None
    has_area: bool = Field(description="whether the light is a surface; skies, points and directions have no area form")
    is_visible: bool = Field(description="V: nothing lies between")
    distance: float | None
    cos_theta: float = Field(description="at p")
    cos_light: float | None = Field(description="at p′; not positive: the lamp shows its back")
    geometry: float | None = Field(description="G = cosθ cosθ′ / distance²")
    f: float | None = Field(description="BSDF towards the camera")
    emitted: float | None = Field(description="Le towards p")
    pdf: float | None = Field(description="density of the point, per solid angle at p")
    pdf_area: float | None = Field(description="the same, per area")
    estimate: float = Field(description="f Le V G / pdf_area")


class LightPoints(BaseModel):
    """Points on the lights of a scene; none where no light can be sampled."""

    points: list[LightPoint]
    is_placed: bool = Field(description="whether the camera's projection is known: points have columns and rows")


class ExtremeRung(BaseModel):
    """A place on the ladder of an extreme."""

    at: float = Field(description="how extreme: an angle, a distance, a number of samples, …")
    exact: float
    naive: float | None = Field(description="by the naive formula in float32; null where that is no number")
    ours: float
    half: float = Field(description="half-width of the 95 % interval of what was rendered; 0 where nothing is random")
    places: int = Field(description="of the ladder")


class TradePoint(BaseModel):
    """A setting's error after some seconds, with its 95 % interval."""

    seconds: float
    spp: float
    error: float
    low: float
    high: float


class TradeTime(BaseModel):
    """Seconds to a target error with their 95 % interval; null where they are not known, or there is no such time."""

    target: float
    seconds: float | None
    low: float | None
    high: float | None
    is_measured: bool = Field(description="the run got there; else a forecast")


class TradeSetting(BaseModel):
    """What one setting costs. All seconds are those of the scene's own picture; low and high bound 95 % intervals."""

    name: str
    group: str = Field(description="what it differs in: default, technique, replicate size, sampling or depth")
    technique: Technique
    curve: list[TradePoint]
    seconds: float = Field(description="that it had by now")
    samples_per_second: float | None
    work: float | None = Field(description="squared error × seconds, a constant of the setting; null: not known yet")
    work_low: float | None
    work_high: float | None
    times: float | None = Field(description="the default's time that the same error takes")
    times_low: float | None
    times_high: float | None
    times_to: list[TradeTime]
    lost_light: float = Field(description="share of the light that a shallower depth leaves out")
    is_trusted: bool = Field(description="false: most pixels' intervals cannot be believed, it may be far worse")
    cannot_see: list[str] = Field(description="light that this technique never finds: its error does not know of that")


class Trade(BaseModel):
    """Error against time of a scene's settings, the default first: what is known by now."""

    share: float = Field(description="of what is to be measured, what is done: 0 to 1")
    is_done: bool
    at_work: str | None = Field(description="the setting whose turn is next")
    seconds: float = Field(description="of rendering that each setting gets, at the size measured")
    width: int = Field(description="of the picture that is measured")
    height: int
    full_width: int = Field(description="of the scene's own picture")
    full_height: int
    full_size: float = Field(description="its pixels over those measured")
    settings: list[TradeSetting]


class KernelCost(BaseModel):
    """What a kernel costs. low, high: 95 % interval of render_ratio, its time over the lean one's."""

    name: str
    operations: int
    compile_seconds: float
    render_seconds: float
    render_ratio: float
    low: float
    high: float


class KernelTrade(BaseModel):
    """The lean kernel of a scene and the one that has all that any scene may need; null until they are measured."""

    is_done: bool
    steps: int = Field(description="compilations and rounds that it takes")
    left_out: list[str] = Field(description="what the lean one leaves out")
    lean: KernelCost | None
    full: KernelCost | None


class IntegralConditions(BaseModel):
    """Whether p is a density with which f may be sampled."""

    mass: float | None = Field(description="∫ p as it was given; p is divided by it. Null where it is not finite")
    is_positive: bool
    negative_at: float | None = Field(description="where p is below zero, or no number")
    unseen: float = Field(description="share of ∫ |f| where p is zero: no point ever sees it")


class IntegralCurve(BaseModel):
    """f and p at places x; null where they are no numbers."""

    x: list[float]
    f: list[float | None]
    p: list[float | None]


class IntegralEstimate(BaseModel):
    """An integral of one dimension from n points. Null is what a single point cannot tell."""

    value: float
    n: int
    variance: float | None = Field(description="V, of one point")
    standard_error: float | None = Field(description="√(V/n)")
    low: float | None = Field(description="of the 95 % interval")
    high: float | None
    truth: float = Field(description="by quadrature")
    truth_error: float = Field(description="how far off that may be")
    conditions: IntegralConditions
    curve: IntegralCurve
    points: IntegralCurve


class IntegralRuns(BaseModel):
    """Estimates of many runs: values[run][i] is from counts[i] points."""

    counts: list[int]
    values: list[list[float]]
    truth: float


class Hello(BaseModel):
    """First event of every stream: a new server id means that the server was started again."""

    server: str
    last_event_id: int


class Deleted(BaseModel):
    """A job is gone, with its pictures."""

    id: str


class Ping(BaseModel):
    """Nothing happened, and the connection is well."""

    at: str


class FrameHeader(BaseModel):
    """JSON header of a frame body: see the description of the frame's address for the layout."""

    seq: int
    width: int = Field(description="of the planes, after reduction")
    height: int
    channels: list[Literal["R", "G", "B", "SE", "N"]]
    spp_min: float
    spp_max: float
    spp_mean: float
    replicates_min: int
    replicates_max: int
    replicate_size: int
    seconds: float
    scale: float = Field(description="a power of two; half = value * scale")
    reduce: Literal[1, 2] = Field(description="2: each pixel is the mean of 2x2")
    layout: Literal["byteplanes-half"]
    rounded: bool
    filled: bool = Field(description="some pixels without samples show their neighbour's value")
    clamped: int = Field(description="finite values too large for the frame, shown as the largest")


class SessionRequest(_Request):
    """A key to be kept in a cookie of the browser."""

    key: SecretStr = Field(min_length=1, max_length=200)


class Session(BaseModel):
    """Who asks. client null: no keys are asked for."""

    client: str | None
    role: Literal["read", "submit", "admin"]
    keys_required: bool


class FieldError(BaseModel):
    """One field that was refused."""

    field: str
    message: str


class Problem(BaseModel):
    """RFC 9457 problem body of every error."""

    type: str
    title: str
    status: int
    detail: str
    errors: list[FieldError] | None = None


class Health(BaseModel):
    """The server answers."""

    status: Literal["ok"]


class Readiness(BaseModel):
    """Whether jobs start at once, and if not, what is missing."""

    status: Literal["ready", "starting"]
    renderer: Literal["warm", "starting", "down"]
    not_ready: list[str]
