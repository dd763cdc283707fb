"""Compiles a source into a `Scene`: parse, measure, rewrite, instantiate. Kernels are traced once per model."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.backend import using, variant_for
from renderer.scene import rewrite
from renderer.scene.limits import SceneLimits
from renderer.scene.numerics import THIN_GAP_LISTED
from renderer.scene.requirements import NO_EMITTERS, Requirements, measure, refuse_unsupported, warnings_of
from renderer.scene.rewrite import passes
from renderer.scene.rewrite.similarity import Similarity
from renderer.scene.source import Parsed, instantiate, load_part, parse
from renderer.settings import UNLIMITED_DEPTH, Settings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from renderer.equation.path import Model, PathKernel

# Sensors whose rays depend on the film's aspect ratio alone.
_SHAPE_ONLY_SENSORS = ("perspective", "thinlens", "orthographic")


@dataclass
class Scene:
    """A scene ready to render. width, height: of the image. digest: identity of its contents, in hexadecimal.

    variant: of Mitsuba, that `mitsuba_scene` and `sensor` belong to; use them inside `backend.using(variant)`.
    similarity: from the scene as it was written to the one that is rendered. rewrites: those that were done.
    is_listed: whether it has so few primitives that trying all of them is faster than a tree.
    """

    source: str | Path | dict[str, Any]
    name: str
    digest: str
    width: int
    height: int
    requirements: Requirements
    mitsuba_scene: Any
    sensor: Any
    variant: str
    similarity: Similarity
    rewrites: tuple[str, ...]
    is_listed: bool
    _parsed: Parsed = field(repr=False)
    _kernels: dict[Any, PathKernel] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        from renderer.equation.loaded import note_loaded  # not above: what lists the gallery needs no Mitsuba

        note_loaded(self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is legal but odd about the scene."""
        return self.requirements.warnings

    @property
    def colour(self) -> str:
        """How radiance depends on wavelength: mono, rgb or spectral."""
        return self.variant.rsplit("_", 1)[1]

    @property
    def film(self) -> list[int]:
        """Film width and height, crop offset and crop size: they decide what a pixel sees."""
        film = self.sensor.film()
        return [int(n) for part in (film.size(), film.crop_offset(), film.crop_size()) for n in part]

    def resolved(self, settings: Settings, replicate_size: int) -> Settings:
        """Settings with everything that the scene decides filled in."""
        depth = self.requirements.max_depth if settings.max_depth is None else settings.max_depth
        return replace(
            settings,
            width=self.width,
            height=self.height,
            max_depth=UNLIMITED_DEPTH if depth < 0 else depth,
            replicate_size=replicate_size,
            colour=self.colour,
        )

    def sized(self, settings: Settings) -> Scene:
        """This scene at the size that the settings ask for, sharing all but the sensor; another colour loads again."""
        if settings.colour not in ("auto", self.colour):
            return load_scene(self.source, settings=settings, rewrites=self.rewrites)
        if settings.width in (None, self.width) and settings.height in (None, self.height):
            return self
        with using(self.variant):
            sensor, width, height = _make_sensor(self._parsed, self.mitsuba_scene, settings.width, settings.height)
        return replace(self, sensor=sensor, width=width, height=height, _kernels={})

    def model(self, settings: Settings, *, full: bool = False) -> Model:
        """What the kernel for resolved settings has to contain. full: also features that this scene does not need."""
        from renderer.equation.path import Model
        from renderer.equation.roulette import first_play

        needs = self.requirements
        depth = settings.max_depth if settings.max_depth is not None else UNLIMITED_DEPTH
        return Model(
            technique=settings.technique,
            max_depth=depth,
            rr_depth=needs.rr_depth,
            replicate_size=settings.replicate_size or 1,
            # On mirrors and clear glass alone, no point on a light can be connected.
            has_sampleable_emitters=bool(needs.emitters) and (full or needs.has_smooth),
            hide_emitters=needs.hide_emitters,
            has_lens=full or self.sensor.needs_aperture_sample(),
            splits_lobes="blendbsdf" in needs.bsdfs and needs.has_delta,
            has_transmission=full or needs.has_transmission,
            has_visible_emitters=full or needs.has_visible_emitters,
            needs_time=full or needs.needs_time,
            has_delta=full or needs.has_delta,
            has_roulette=full or depth < 0 or depth > first_play(needs.rr_depth),
            has_tree=full or not self.is_listed,
            needs_uv=full or needs.needs_uv,
        )

    def kernel(self, settings: Settings) -> PathKernel:
        """The kernel for resolved settings."""
        return self.kernel_of(self.model(settings))

    def kernel_of(self, model: Model) -> PathKernel:
        """The kernel of a model. Kernels that differ by the size of replicates alone are one."""
        from renderer.equation.path import PathKernel

        base = replace(model, replicate_size=1)
        with using(self.variant):
            if base not in self._kernels:
                self._kernels[base] = PathKernel(self.mitsuba_scene, self._camera(), (self.width, self.height), base)
            if model not in self._kernels:
                self._kernels[model] = self._kernels[base].with_replicates_of(model.replicate_size)
        return self._kernels[model]

    def channels(self, settings: Settings, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
        """What lies behind each pixel, by name: see `renderer.equation.channels`. settings: resolved ones."""
        from renderer.equation.channels import render_channels

        found = render_channels(self.kernel(settings), names, self.width, self.height, settings.seed)
        # In the scene's own coordinates, not in those that it is rendered in; 0 stands for "nothing there".
        if "depth" in found:
            found["depth"] = self.similarity.original_distance(found["depth"]).astype("float32")
        if "position" in found:
            original = self.similarity.original_position(found["position"])
            is_nothing = (found["position"] == 0).all(axis=-1, keepdims=True)
            found["position"] = np.where(is_nothing, 0, original).astype(np.float32)
        return found

    def cannot_see(self, settings: Settings) -> tuple[str, ...]:
        """What the technique of resolved settings cannot find: "point light 'lamp'"."""
        from renderer.equation.reach import cannot_see

        depth = settings.max_depth if settings.max_depth is not None else UNLIMITED_DEPTH
        with using(self.variant):
            return cannot_see(settings.technique, self.mitsuba_scene, depth)

    def _camera(self) -> Any:
        """The sensor as the kernel uses it: on the smallest film of the same shape.

        Mitsuba's cameras compile the film's size in, though only its shape matters: so all sizes share a kernel.
        """
        description = rewrite.sensor_dict(self._parsed.state, self.width, self.height)
        is_cropped = self.film[:2] != self.film[4:]
        if is_cropped or description["type"] not in _SHAPE_ONLY_SENSORS:
            return self.sensor
        divisor = math.gcd(self.width, self.height)
        return _make_sensor(self._parsed, self.mitsuba_scene, self.width // divisor, self.height // divisor)[0]


def load_scene(
    source: str | Path | dict[str, Any],
    *,
    settings: Settings | None = None,
    limits: SceneLimits | None = None,
    rewrites: Collection[str] = passes.ALL,
) -> Scene:
    """Loads an .xml, .zip or .json file, a Mitsuba dictionary or a gallery name.

    settings: only width, height and colour matter here. limits: `UNTRUSTED` for what strangers send. rewrites: those
    to do, to compare with and without. Raises SceneError (or UnsupportedScene) with place and cause.
    """
    return load_parsed(source, parse(source, limits), settings or Settings(), rewrites)


def load_parsed(
    source: str | Path | dict[str, Any], parsed: Parsed, asked: Settings, rewrites: Collection[str] = passes.ALL
) -> Scene:
    """Loads what was parsed from a source. Raises as `load_scene` does."""
    from renderer.equation.primitives import primitives_of

    passes.check_names(rewrites)
    needs = measure(parsed)
    refuse_unsupported(needs)
    changed, similarity, notes = passes.before_loading(parsed, needs, rewrites)
    rewrite.sensor_dict(changed.state, asked.width, asked.height)  # refuses bad sizes before anything is loaded
    variant = variant_for(asked.colour, needs.is_coloured)
    with using(variant):
        made = instantiate(changed)
        notes += passes.after_loading(made, rewrites, parsed.name)
        sensor, width, height = _make_sensor(changed, made, asked.width, asked.height)
        is_listed = primitives_of(made) is not None
    needs = replace(needs, notes=notes)
    if is_listed:  # rays start on its surfaces, not a hair above
        needs = replace(needs, warnings=warnings_of(parsed, THIN_GAP_LISTED))
    if needs.emitters and not made.emitters():
        needs = replace(needs, warnings=(*needs.warnings, NO_EMITTERS))
    digest = passes.digest_with(parsed.digest, rewrites)
    placing = (similarity, tuple(rewrites), is_listed)
    return Scene(source, parsed.name, digest, width, height, needs, made, sensor, variant, *placing, changed)


def _make_sensor(parsed: Parsed, scene: Any, width: int | None, height: int | None) -> tuple[Any, int, int]:
    """The sensor at the asked size, with the width and height of its image."""
    description = rewrite.sensor_dict(parsed.state, width, height)
    sensor = load_part(parsed, description)
    sensor.set_scene(scene)
    size = sensor.film().crop_size()
    width, height = int(size[0]), int(size[1])
    rewrite.check_memory(width, height)
    return sensor, width, height
