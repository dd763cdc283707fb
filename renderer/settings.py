"""What is asked: `Settings` says which estimator, `Target` says when it is good enough.

Both are frozen, and both reject bad values when they are built, by name and range. Settings are part of the identity
of an estimate (two estimates merge only when their settings agree); a target is not.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np

from renderer.camera import Camera
from renderer.errors import SettingsError
from renderer.region import Region

CHANNELS = ("albedo", "normal", "depth", "position", "shape_index", "alpha", "stokes")
STOKES = "stokes"  # the channel that has light polarised, and S0 to S3 told with their standard errors
COLOURS = ("auto", "mono", "rgb", "spectral")
GUIDES = ("off", "on")
TECHNIQUES = ("mis", "bsdf", "emitter", "cosine", "uniform")
MAX_SIDE = 16384
MAX_SENSORS = 1_000_000
MAX_REPLICATE_SIZE = 64
DEFAULT_REPLICATE_SIZE = 16
ENOUGH_REPLICATES = 16  # of a pixel in the mean, so that nearly all have enough for an interval that may be trusted,
ENOUGH_FOR_TRUST = 4  # samples in each of them at least: with fewer in all than 64, stratification is worth more
LOOSE_ERROR = 0.05  # asked for; at twice as much there will be a fourth of the samples, and a replicate has a fourth,
LEAST_FOR_LOOSE = 2  # or at least this many
UNLIMITED_DEPTH = -1
DEFAULT_CONFIDENCE = 0.95


def _whole(name: str, value: object, low: int, high: int) -> int:
    """A whole number of any library as Python's own. Raises SettingsError for anything else."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not low <= int(value) <= high:
        raise SettingsError(f"{name} is {value!r}; it must be a whole number from {low} to {high}")
    return int(value)


def _number(name: str, value: object, low: float, high: float) -> float:
    """A number of any library as Python's own. Raises SettingsError for anything else."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise SettingsError(f"{name} is {value!r}; it must be a number from {low:g} to {high:g}")
    plain = int(value) if isinstance(value, Integral) else float(value)  # some are too large for a float
    if not low <= plain <= high:
        raise SettingsError(f"{name} is {value!r}; it must be from {low:g} to {high:g}")
    return plain


@dataclass(frozen=True, slots=True)
class Settings:
    """Which estimator to run.

    width, height: pixels of the image, 1 … 16384; None takes the scene's film (one given scales the other).
    seed: 0 … 2^63 − 1. Equal seeds give equal images, bit for bit.
    max_depth: as in Mitsuba (1 = only emitters seen directly, −1 = unlimited); None takes the scene's.
    technique: how incident directions are sampled: mis, bsdf, emitter, cosine or uniform.
    replicate_size: samples in one replicate, a power of two up to 64; None chooses by the target.
    colour: how radiance depends on wavelength: mono, rgb or spectral; auto takes mono where nothing is coloured, else
    rgb, and spectral where a spectrum says nothing else. Images are linear sRGB in each.
    adaptive: sample pixels more often where that lowers the image error most; else all alike, as those that share
    samples are in any case.
    channels: what else to say of each pixel: albedo, normal, depth, position, shape_index, alpha; stokes renders
    polarised light. Those that the scene asks for itself come without being named.
    sensor: which of the scene's, by name or by index from 0; None takes the first.
    camera: where the sensor stands and looks instead of where the scene puts it: a `Camera`, or a dictionary of its
    fields.
    independent_pixels: give each sample to one pixel alone, so that errors of neighbours are independent (white noise)
    and pixels can be sampled unequally; else it counts in all pixels that the film's filter reaches, which leaves less
    variance. None shares wherever the filter is wider than a pixel and no region is asked for.
    guide: "on" learns where light comes from before the first sample, and draws directions by that, too (see
    `equation/guide.py`): for scenes whose light arrives by bounces. Where it cannot serve (other techniques than mis,
    media, meters, paths of one segment) it resolves to "off".
    """

    width: int | None = None
    height: int | None = None
    seed: int = 0
    max_depth: int | None = None
    technique: str = "mis"
    replicate_size: int | None = None
    colour: str = "auto"
    adaptive: bool = True
    channels: tuple[str, ...] = ()
    sensor: str | int | None = None
    independent_pixels: bool | None = None
    camera: Camera | None = None
    guide: str = "off"

    def __post_init__(self) -> None:
        if isinstance(self.channels, str):
            names = ", ".join(f"{name!r}" for name in self.channels.split(","))
            raise SettingsError(f"channels is {self.channels!r}; give a list of names: [{names}]")
        object.__setattr__(self, "channels", tuple(self.channels))  # JSON has lists only
        for name in self.channels:
            if name not in CHANNELS:
                raise SettingsError(f"channel {name!r} is not known; choose from {', '.join(CHANNELS)}")
        for name in ("width", "height"):
            if (side := getattr(self, name)) is not None:
                object.__setattr__(self, name, _whole(name, side, 1, MAX_SIDE))
        object.__setattr__(self, "seed", _whole("seed", self.seed, 0, 2**63 - 1))
        if self.sensor is not None and not isinstance(self.sensor, str):
            object.__setattr__(self, "sensor", _whole("sensor", self.sensor, 0, MAX_SENSORS - 1))
        object.__setattr__(self, "camera", Camera.of(self.camera))
        if self.max_depth is not None:
            depth = _whole("max_depth", self.max_depth, UNLIMITED_DEPTH, 1_000_000)
            object.__setattr__(self, "max_depth", depth)
        if self.technique not in TECHNIQUES:
            raise SettingsError(f"technique is {self.technique!r}; choose one of {', '.join(TECHNIQUES)}")
        if self.guide not in GUIDES:
            raise SettingsError(f"guide is {self.guide!r}; choose one of {', '.join(GUIDES)}")
        if self.colour not in COLOURS:
            raise SettingsError(f"colour is {self.colour!r}; choose one of {', '.join(COLOURS)}")
        if isinstance(self.adaptive, np.bool_):
            object.__setattr__(self, "adaptive", bool(self.adaptive))
        if not isinstance(self.adaptive, bool):
            raise SettingsError(f"adaptive is {self.adaptive!r}; it must be true or false")
        if self.independent_pixels not in (None, True, False):
            raise SettingsError(f"independent_pixels is {self.independent_pixels!r}; it must be true or false")
        if (size := self.replicate_size) is not None:
            size = _whole("replicate_size", size, 1, MAX_REPLICATE_SIZE)
            object.__setattr__(self, "replicate_size", size)
            if size & (size - 1):
                raise SettingsError(f"replicate_size is {size}; it must be a power of two up to {MAX_REPLICATE_SIZE}")

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        return asdict(self) | {"camera": None if self.camera is None else self.camera.as_dict()}


def image_size(own: tuple[int, int], width: int | None, height: int | None) -> tuple[int, int]:
    """Pixels of an image that is `own` by itself: as asked; one side given scales the other; neither: its own."""
    if width is None and height is None:
        return own
    if width is None:
        assert height is not None
        return max(1, round(own[0] * height / own[1])), height
    return width, max(1, round(own[1] * width / own[0])) if height is None else height


@dataclass(frozen=True, slots=True)
class Target:
    """When to stop. Any combination; the first limit reached wins.

    error: relative image error as a fraction (0.02 = 2 %), 0 < error ≤ 10.
    confidence: how sure to be that the true error is below, 0.5 … 0.9999; 0.95 where an error is given.
    share: stop when this share of the pixels (0 … 1) has an error of its own below `error`, instead of the image's.
    region: [x, y, width, height] or a (H, W) mask: the pixels whose error counts; None is the whole image.
    seconds: render time. spp: samples per pixel, in the mean.
    """

    error: float | None = None
    seconds: float | None = None
    spp: int | None = None
    confidence: float | None = None
    share: float | None = None
    region: Any = None

    def __post_init__(self) -> None:
        if self.error is None and self.seconds is None and self.spp is None:
            raise SettingsError("the target is empty; give at least one of error, seconds or spp")
        ranges = (("error", 1e-6, 10.0), ("seconds", 1e-3, 1e8), ("confidence", 0.5, 0.9999), ("share", 0.01, 0.9999))
        for name, low, high in ranges:
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _number(name, value, low, high))
        if self.spp is not None:
            object.__setattr__(self, "spp", _whole("spp", self.spp, 1, 2**31))
        if self.error is None:
            for name in ("confidence", "share", "region"):
                if getattr(self, name) is not None:
                    raise SettingsError(f"{name} is given without an error; say which error it is about")
        elif self.confidence is None:
            object.__setattr__(self, "confidence", DEFAULT_CONFIDENCE)
        if self.region is not None:
            object.__setattr__(self, "region", Region.of(self.region))

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages; of a mask its bounds alone."""
        return asdict(self) | {"region": None if self.region is None else self.region.as_list()}


def replicate_size_for(settings: Settings, target: Target) -> int:
    """Samples per replicate: as asked, else 16, or less where few samples will do, so that an error bar is left.

    A replicate is the unit of every error bar; below four of them an interval says next to nothing, and below twelve no
    pixel is trusted. The more samples stratify each other, the less noise: where the target says that there will be
    many, and asks for no error that might be reached before, a replicate has up to 64. Where it is a time, this is
    the most that one may have: how many fit is known once the pace of the machine is (`budget.replicate_size`).
    """
    if settings.replicate_size is not None:
        return settings.replicate_size
    size = DEFAULT_REPLICATE_SIZE
    if target.error is not None:
        wanted = size * (LOOSE_ERROR / target.error) ** 2
        while size > LEAST_FOR_LOOSE and wanted * 2**0.5 < size:
            size //= 2
    while target.spp is not None and size > 1 and target.spp < 4 * size:
        size //= 2
    if target.error is not None:
        return size
    spp = math.inf if target.spp is None else target.spp
    while size > ENOUGH_FOR_TRUST and spp < ENOUGH_REPLICATES * size:
        size //= 2
    while 2 * size <= MAX_REPLICATE_SIZE and spp >= ENOUGH_REPLICATES * 2 * size:
        size *= 2
    return size
