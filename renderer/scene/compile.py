"""Compiles a source into a `Scene`: parse, measure, rewrite, instantiate. Kernels are traced once per model."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from renderer.backend import colour_of, mitsuba, one_at_a_time, using, variant_for
from renderer.camera import Camera
from renderer.errors import SceneError, SettingsError
from renderer.estimate.correlation import INDEPENDENT, Correlation
from renderer.scene import rewrite
from renderer.scene.geometry import STAND_IN
from renderer.scene.limits import SceneLimits
from renderer.scene.loaded_lights import make_maps_finite, missing_attributes, unsampleable_light
from renderer.scene.loaded_media import unnamed_medium
from renderer.scene.numerics import THIN_GAP_LISTED
from renderer.scene.parameters import Source
from renderer.scene.requirements import NO_EMITTERS, Requirements, measure, refuse_unsupported, warnings_of
from renderer.scene.rewrite import passes
from renderer.scene.rewrite.byte_colours import display_colours
from renderer.scene.rewrite.similarity import Similarity
from renderer.scene.source import Parsed, instantiate, load_part, parse
from renderer.settings import STOKES, UNLIMITED_DEPTH, Settings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from renderer.audit.value import Audit
    from renderer.equation.path import Model, PathKernel

# Sensors whose rays depend on the film's aspect ratio alone.
_SHAPE_ONLY_SENSORS = ("perspective", "thinlens", "orthographic")


@dataclass
class Scene:
    """A scene ready to render. width, height: of the image. digest: identity of its contents, in hexadecimal.

    variant: of Mitsuba, that `mitsuba_scene` and `sensor` belong to; use them inside `backend.using(variant)`.
    similarity: from the scene as it was written to the one that is rendered. rewrites: those that were done.
    sensors: those of the scene, of which `sensor_index` is the one that is rendered. is_sensor_chosen: by the caller.
    camera: what differs from that sensor as the scene has it.
    is_listed: whether it has so few primitives that trying all of them is faster than a tree.
    """

    source: Source
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
    sensors: tuple[rewrite.SensorFacts, ...]
    sensor_index: int
    is_sensor_chosen: bool
    camera: Camera | None
    _parsed: Parsed = field(repr=False)
    _sensor_warnings: tuple[str, ...] = field(default=(), repr=False)
    _kernels: dict[Any, PathKernel] = field(default_factory=dict, repr=False)
    _audits: dict[Any, Audit | None] = field(default_factory=dict, repr=False)
    _missed: dict[Any, tuple[str, ...]] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        from renderer.equation.loaded import note_loaded  # not above: what lists the gallery needs no Mitsuba

        note_loaded(self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is legal but odd about the scene, and about what was left open."""
        several = None if self.is_sensor_chosen else rewrite.several_sensors(self.sensors)
        found = (*self.requirements.warnings, *self._sensor_warnings, *self.requirements.unheard)
        return found if several is None else (*found, several)

    @property
    def colour(self) -> str:
        """How radiance depends on wavelength: mono, rgb or spectral."""
        return colour_of(self.variant)

    @property
    def is_polarised(self) -> bool:
        """Whether light is polarised."""
        return self.requirements.polarised_by is not None

    @property
    def is_meter(self) -> bool:
        """Whether the sensor meters the irradiance of a shape."""
        return hasattr(self.sensor, "vertex")

    @property
    def film(self) -> list[int]:
        """Film width and height, crop offset and crop size: they decide what a pixel sees."""
        film = self.sensor.film()
        return [int(n) for part in (film.size(), film.crop_offset(), film.crop_size()) for n in part]

    def resolved(self, settings: Settings, replicate_size: int) -> Settings:
        """Settings with everything that the scene decides filled in."""
        from renderer.equation.film import shares_samples

        depth = self.requirements.max_depth if settings.max_depth is None else settings.max_depth
        is_apart = bool(settings.independent_pixels) or not shares_samples(self.sensor.film().rfilter())
        return replace(
            settings,
            independent_pixels=is_apart,
            adaptive=settings.adaptive and is_apart,
            width=self.width,
            height=self.height,
            max_depth=UNLIMITED_DEPTH if depth < 0 else depth,
            replicate_size=replicate_size,
            colour=self.colour,
            sensor=self.sensor_index,
            camera=self.camera,
            guide=settings.guide if self._can_be_guided(settings.technique, depth) else "off",
        )

    def _can_be_guided(self, technique: str, depth: int) -> bool:
        """Whether a guide could serve paths of this technique and depth here."""
        needs = self.requirements
        is_apt = needs.has_smooth and not needs.media and not self.is_meter and not self.is_polarised
        return is_apt and technique == "mis" and depth not in (0, 1)

    def sized(self, settings: Settings) -> Scene:
        """This scene with the size, sensor and camera that the settings ask for; another colour loads again, else all
        but the sensor is shared.
        """
        is_chosen = self.is_sensor_chosen or settings.sensor is not None
        index = self.sensor_index if settings.sensor is None else rewrite.chosen_sensor(self.sensors, settings.sensor)
        camera = self.camera if settings.camera is None else settings.camera
        if settings.colour not in ("auto", self.colour) or (STOKES in settings.channels and not self.is_polarised):
            asked = replace(settings, sensor=index if is_chosen else None, camera=camera)
            return load_scene(self.source, settings=asked, rewrites=self.rewrites)
        is_same_size = settings.width in (None, self.width) and settings.height in (None, self.height)
        if index == self.sensor_index and camera == self.camera and is_same_size:
            return self if is_chosen == self.is_sensor_chosen else replace(self, is_sensor_chosen=is_chosen)
        with using(self.variant):
            view = _View(index, camera, self.similarity)
            made = _make_sensor(self._parsed, self.mitsuba_scene, settings.width, settings.height, view)
            sensor, width, height = made
            said = unnamed_medium(self.mitsuba_scene, sensor) if self.requirements.media else ()
        choice: dict[str, Any] = {"sensor_index": index, "is_sensor_chosen": is_chosen, "camera": camera}
        choice |= {"sensor": sensor, "width": width, "height": height, "_sensor_warnings": said}
        return replace(self, _kernels={}, _audits={}, _missed={}, **choice)

    def model(self, settings: Settings, *, full: bool = False) -> Model:
        """What the kernel for resolved settings has to contain. full: also features that this scene does not need."""
        from renderer.equation.path import Model
        from renderer.equation.roulette import first_play

        needs = self.requirements
        depth = settings.max_depth if settings.max_depth is not None else UNLIMITED_DEPTH
        is_meter = self.is_meter
        depth += is_meter and depth > 0  # the metered surface is a vertex of its own
        return Model(
            technique=settings.technique,
            max_depth=depth,
            rr_depth=needs.rr_depth,
            replicate_size=settings.replicate_size or 1,
            # On mirrors and clear glass alone, no point on a light can be connected.
            has_sampleable_emitters=bool(needs.emitters)
            and (full or is_meter or needs.has_smooth or bool(needs.media)),
            hide_emitters=needs.hide_emitters and not is_meter,
            has_lens=full or self.sensor.needs_aperture_sample(),
            splits_lobes="blendbsdf" in needs.bsdfs and needs.has_delta,
            has_transmission=full or needs.has_transmission,
            has_visible_emitters=depth != 0 and (full or needs.has_visible_emitters),
            needs_time=full or needs.needs_time,
            has_delta=full or needs.has_delta,
            has_null=full or needs.has_null,
            has_roulette=full or depth < 0 or depth > first_play(needs.rr_depth),
            has_tree=full or is_meter or not self.is_listed,
            needs_uv=full or needs.needs_uv,
            shares_samples=settings.independent_pixels is False,
            is_meter=is_meter,
            # Of a sky around a medium without end, only emitter sampling finds light, as in Mitsuba: how much is up to
            # the choice among lights, which stays the one by power.
            surveys_lights=not (needs.media and needs.has_environment and self.sensor.get_medium() is not None),
            has_media=bool(needs.media),
            is_guided=settings.guide == "on",
        )

    def correlation(self, settings: Settings) -> Correlation:
        """Of neighbouring pixels, with resolved settings."""
        from renderer.equation.film import SharedFilm

        with using(self.variant):
            return INDEPENDENT if settings.independent_pixels else SharedFilm(self.sensor.film().rfilter()).correlation

    def kernel(self, settings: Settings) -> PathKernel:
        """The kernel for resolved settings."""
        return self.kernel_of(self.model(settings))

    def kernel_of(self, model: Model) -> PathKernel:
        """The kernel of a model. Kernels that differ by the size of replicates alone are one."""
        from renderer.equation.guide_training import learn
        from renderer.equation.path import PathKernel
        from renderer.equation.volume_path import VolumeKernel

        base = replace(model, replicate_size=1)
        with using(self.variant):
            if base not in self._kernels:
                of = self.mitsuba_scene, self._camera(), (self.width, self.height), base
                guide = learn(self.kernel_of(replace(base, is_guided=False))) if base.is_guided else None
                self._kernels[base] = VolumeKernel(*of) if base.has_media else PathKernel(*of, guide)
            if model not in self._kernels:
                self._kernels[model] = self._kernels[base].with_replicates_of(model.replicate_size)
        return self._kernels[model]

    def channels(self, settings: Settings, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
        """What lies behind each pixel, by name: see `renderer.equation.channels`. settings: resolved ones. Of Stokes
        vectors the moments tell."""
        from renderer.equation.channels import render_channels

        names = tuple(name for name in names if name != STOKES)
        if not names:
            return {}
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
            has_media = bool(self.requirements.media)
            return cannot_see(settings.technique, self.mitsuba_scene, depth, passes_null=has_media)

    def missed_lights(self, settings: Settings) -> tuple[str, ...]:
        """Sentences about lights of which the kernel's own sampler misses a part. Worked out once."""
        from renderer.equation.lights.check import lights_that_are_missed, lights_worth_checking

        model = replace(self.model(settings), replicate_size=1)
        if model not in self._missed:
            with using(self.variant):
                if not model.samples_emitters or not lights_worth_checking(self.mitsuba_scene):
                    return ()
                sampler = self.kernel_of(model).emitters
                self._missed[model] = lights_that_are_missed(self.mitsuba_scene, sampler)
        return self._missed[model]

    def needs_audit(self, settings: Settings) -> bool:
        """Whether there may be light that resolved settings hardly find, told from the scene alone."""
        from renderer.audit.run import is_needed

        return is_needed(self, settings)

    def audit(self, settings: Settings) -> Audit | None:
        """What paths from the lights find of light that resolved settings hardly find; None where there can be none.
        Worked out once."""
        from renderer.audit.run import audit

        key = settings.technique, settings.max_depth, settings.seed
        if key not in self._audits:
            self._audits[key] = audit(self, settings)
        return self._audits[key]

    def _camera(self) -> Any:
        """The sensor as the kernel uses it: on the smallest film of the same shape.

        Mitsuba's cameras compile the film's size in, though only its shape matters: so all sizes share a kernel.
        """
        view = _View(self.sensor_index, self.camera, self.similarity)
        description = rewrite.sensor_dict(self._parsed.state, self.width, self.height, view.index)
        is_cropped = self.film[:2] != self.film[4:]
        if is_cropped or description["type"] not in _SHAPE_ONLY_SENSORS:
            return self.sensor
        divisor = math.gcd(self.width, self.height)
        shape = self.width // divisor, self.height // divisor
        return _make_sensor(self._parsed, self.mitsuba_scene, *shape, view)[0]


@dataclass(frozen=True, slots=True)
class _View:
    """Which sensor, what differs from it, and how its scene lies to the one that was read."""

    index: int
    camera: Camera | None
    similarity: Similarity


def load_scene(
    source: Source,
    *,
    settings: Settings | None = None,
    limits: SceneLimits | None = None,
    rewrites: Collection[str] = passes.ALL,
) -> Scene:
    """Loads an .xml, .zip or .json file, a Mitsuba dictionary or a gallery name.

    settings: only width, height, sensor, camera, colour and the channel stokes matter here. limits: `UNTRUSTED` for
    what strangers send. rewrites: those to do, to compare with and without. Raises SceneError (or UnsupportedScene)
    with place and cause.
    """
    with one_at_a_time:
        return load_parsed(source, parse(source, limits), settings or Settings(), rewrites)


def load_parsed(source: Source, parsed: Parsed, asked: Settings, rewrites: Collection[str] = passes.ALL) -> Scene:
    """Loads what was parsed from a source. Raises as `load_scene` does."""
    from renderer.equation.primitives import primitives_of

    passes.check_names(rewrites)
    needs = measure(parsed, STOKES in asked.channels)
    refuse_unsupported(needs)
    changed, similarity, notes = passes.before_loading(parsed, needs, rewrites)
    sensors = rewrite.sensors_of(changed.state)
    view = _View(rewrite.chosen_sensor(sensors, asked.sensor), asked.camera, similarity)
    _described(changed, asked.width, asked.height, view)  # refuses bad sizes and views before anything is loaded
    if needs.spectral_by is not None and asked.colour in ("mono", "rgb"):
        raise SettingsError(
            f"colour is {asked.colour!r}, and {parsed.name} has a spectrum of the type {needs.spectral_by}, which has "
            "values for wavelengths only; take colour spectral or auto"
        )
    if needs.polarised_by is not None and asked.colour == "rgb":
        raise SettingsError(
            f"colour is 'rgb', and {parsed.name} asks for polarised light ({needs.polarised_by}), which Mitsuba has no "
            "rgb variant for; take colour spectral, mono or auto"
        )
    found = needs.is_coloured, needs.spectral_by is not None, needs.polarised_by is not None
    variant = variant_for(asked.colour, *found)
    with using(variant):
        with display_colours(changed) as (loadable, told):
            made = instantiate(loadable)
        notes += told
        notes += passes.after_loading(made, rewrites, parsed.name)
        loaded_warnings = (*make_maps_finite(made), *missing_attributes(changed.state, made))
        if (why := unsampleable_light(made)) is not None:
            made = None  # while it is there, Mitsuba would ask it in the kernels of all other scenes
            raise SceneError(f"{parsed.name}: {why}")
        sensor, width, height = _make_sensor(changed, made, asked.width, asked.height, view)
        is_listed = primitives_of(made) is not None
        said = unnamed_medium(made, sensor) if needs.media else ()
    needs = replace(needs, notes=notes)
    if is_listed:  # rays start on its surfaces, not a hair above
        needs = replace(needs, warnings=warnings_of(parsed, THIN_GAP_LISTED))
    needs = replace(needs, warnings=(*needs.warnings, *loaded_warnings))
    if needs.emitters and not made.emitters():
        needs = replace(needs, warnings=(*needs.warnings, NO_EMITTERS))
    digest = passes.digest_with(parsed.digest, rewrites)
    placing = (similarity, tuple(rewrites), is_listed, sensors, view.index, asked.sensor is not None, asked.camera)
    return Scene(source, parsed.name, digest, width, height, needs, made, sensor, variant, *placing, changed, said)


def _is_meter(part: Any) -> bool:
    return isinstance(part, dict) and part.get("type") == "irradiancemeter"


def _described(parsed: Parsed, width: int | None, height: int | None, view: _View) -> dict[str, Any]:
    """A sensor's dictionary at the asked size. Raises SettingsError for a size or a view that cannot be."""
    described = rewrite.sensor_dict(parsed.state, width, height, view.index)
    name = rewrite.sensors_of(parsed.state)[view.index].label if view.camera is not None else ""
    return rewrite.set_camera(described, view.camera, view.similarity, name)


def _make_sensor(
    parsed: Parsed, scene: Any, width: int | None, height: int | None, view: _View
) -> tuple[Any, int, int]:
    """A sensor at the asked size, with the width and height of its image."""
    index = view.index
    description = _described(parsed, width, height, view)
    shapes = rewrite.metered_shapes(parsed.state, index)
    if shapes:
        parts = {key: part for key, part in description.items() if not _is_meter(part)}
        description = {**parts, "type": STAND_IN}
    sensor = load_part(parsed, description)
    sensor.set_scene(scene)
    if shapes:
        from renderer.equation.meter import WHITE, IrradianceMeter  # not above: what lists the gallery needs no Mitsuba

        loaded = [load_part(parsed, one) for one in shapes]
        if not all(float(one.surface_area()[0]) > 0 for one in loaded):
            raise SceneError(f"{parsed.name}: {rewrite.NO_AREA_TO_METER}")
        sensor = IrradianceMeter(sensor, loaded, load_part(parsed, WHITE))
    has_media = any(node.type == mitsuba().ObjectType.Medium for node in parsed.state.nodes)
    if has_media and (medium := scene.sensors()[index].get_medium()) is not None:  # meters come after cameras
        sensor.set_medium(medium)
    size = sensor.film().crop_size()
    width, height = int(size[0]), int(size[1])
    rewrite.check_memory(width, height)
    return sensor, width, height
