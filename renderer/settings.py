"""What is asked: `Settings` says which estimator, `Target` says when it is good enough.

Both are frozen, and both reject bad values when they are built, by name and range. Settings are part of the identity
of an estimate (two estimates merge only when their settings agree); a target is not.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from renderer.errors import SettingsError
from renderer.region import Region

CHANNELS = ("albedo", "normal", "depth", "position", "shape_index")
COLOURS = ("auto", "mono", "rgb", "spectral")
TECHNIQUES = ("mis", "bsdf", "emitter", "cosine", "uniform")
MAX_SIDE = 16384
MAX_REPLICATE_SIZE = 64
DEFAULT_REPLICATE_SIZE = 16
ENOUGH_REPLICATES = 16  # of a pixel in the mean, so that nearly all have enough for an interval that may be trusted
LOOSE_ERROR = 0.05  # asked for; at twice as much there will be a fourth of the samples, and a replicate has a fourth,
LEAST_FOR_LOOSE = 2  # or at least this many
UNLIMITED_DEPTH = -1
DEFAULT_CONFIDENCE = 0.95


def _whole(name: str, value: object, low: int, high: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise SettingsError(f"{name} is {value!r}; it must be a whole number from {low} to {high}")


@dataclass(frozen=True, slots=True)
class Settings:
    """Which estimator to run.

    width, height: pixels of the image, 1 … 16384; None takes the scene's film (one given scales the other).
    seed: 0 … 2^63 − 1. Equal seeds give equal images, bit for bit.
    max_depth: as in Mitsuba (1 = only emitters seen directly, −1 = unlimited); None takes the scene's.
    technique: how incident directions are sampled: mis, bsdf, emitter, cosine or uniform.
    replicate_size: samples in one replicate, a power of two up to 64; None chooses by the target.
    colour: how radiance depends on wavelength: mono, rgb or spectral; auto takes mono where nothing is coloured, else
    rgb. Images are linear sRGB in each.
    adaptive: sample pixels more often where that lowers the image error most; else all alike.
    channels: what else to say of each pixel: albedo, normal, depth, position, shape_index.
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))  # JSON has lists only
        for name in self.channels:
            if name not in CHANNELS:
                raise SettingsError(f"channel {name!r} is not known; choose from {', '.join(CHANNELS)}")
        for name in ("width", "height"):
            if (side := getattr(self, name)) is not None:
                _whole(name, side, 1, MAX_SIDE)
        _whole("seed", self.seed, 0, 2**63 - 1)
        if self.max_depth is not None:
            _whole("max_depth", self.max_depth, UNLIMITED_DEPTH, 1_000_000)
        if self.technique not in TECHNIQUES:
            raise SettingsError(f"technique is {self.technique!r}; choose one of {', '.join(TECHNIQUES)}")
        if self.colour not in COLOURS:
            raise SettingsError(f"colour is {self.colour!r}; choose one of {', '.join(COLOURS)}")
        if not isinstance(self.adaptive, bool):
            raise SettingsError(f"adaptive is {self.adaptive!r}; it must be true or false")
        if (size := self.replicate_size) is not None:
            _whole("replicate_size", size, 1, MAX_REPLICATE_SIZE)
            if size & (size - 1):
                raise SettingsError(f"replicate_size is {size}; it must be a power of two up to {MAX_REPLICATE_SIZE}")

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        return asdict(self)


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
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise SettingsError(f"{name} is {value!r}; it must be a number from {low:g} to {high:g}")
            if not low <= value <= high:
                raise SettingsError(f"{name} is {value!r}; it must be from {low:g} to {high:g}")
        if self.spp is not None:
            _whole("spp", self.spp, 1, 2**31)
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


def replicate_size_for(settings: Settings, target: Target, spp_per_second: float = 0.0) -> int:
    """Samples per replicate: as asked, else 16, or less where few samples will do, so that an error bar is left.

    A replicate is the unit of every error bar; below four of them an interval says next to nothing. The more samples
    stratify each other, the less noise: where the target says that there will be many, and asks for no error that
    might be reached before, a replicate has up to 64. spp_per_second: to expect where the target is a time.
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
    limits = [] if target.spp is None else [float(target.spp)]
    limits += [] if target.seconds is None else [target.seconds * spp_per_second]
    while 2 * size <= MAX_REPLICATE_SIZE and min(limits) >= ENOUGH_REPLICATES * 2 * size:
        size *= 2
    return size
