"""Compiles a source into a `Scene`: parse, measure, rewrite, instantiate. Kernels are traced once per model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from renderer.errors import SceneError
from renderer.scene import rewrite
from renderer.scene.requirements import Requirements, measure
from renderer.scene.source import instantiate, parse
from renderer.settings import UNLIMITED_DEPTH, Settings

if TYPE_CHECKING:
    from renderer.equation.path import PathKernel


@dataclass
class Scene:
    """A scene ready to render. width, height: of the image. digest: identity of its contents, in hexadecimal."""

    source: str | Path | dict[str, Any]
    name: str
    digest: str
    width: int
    height: int
    requirements: Requirements
    mitsuba_scene: Any
    _kernels: dict[Any, PathKernel] = field(default_factory=dict, repr=False)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is legal but odd about the scene."""
        return self.requirements.warnings

    @property
    def sensor(self) -> Any:
        """The sensor that is rendered: the scene's first."""
        return self.mitsuba_scene.sensors()[0]

    def resolved(self, settings: Settings, replicate_size: int) -> Settings:
        """Settings with everything that the scene decides filled in."""
        depth = self.requirements.max_depth if settings.max_depth is None else settings.max_depth
        return replace(
            settings,
            width=self.width,
            height=self.height,
            max_depth=UNLIMITED_DEPTH if depth < 0 else depth,
            replicate_size=replicate_size,
        )

    def sized(self, settings: Settings) -> Scene:
        """This scene at the size that the settings ask for; itself where that is its size already."""
        if settings.width in (None, self.width) and settings.height in (None, self.height):
            return self
        return load_scene(self.source, settings=settings)

    def kernel(self, settings: Settings) -> PathKernel:
        """The kernel for resolved settings."""
        from renderer.equation.path import Model, PathKernel

        needs = self.requirements
        model = Model(
            technique=settings.technique,
            max_depth=settings.max_depth if settings.max_depth is not None else UNLIMITED_DEPTH,
            rr_depth=needs.rr_depth,
            replicate_size=settings.replicate_size or 1,
            has_sampleable_emitters=bool(needs.emitters),
            hide_emitters=needs.hide_emitters,
            has_lens=self.sensor.needs_aperture_sample(),
        )
        if model not in self._kernels:
            self._kernels[model] = PathKernel(self.mitsuba_scene, self.sensor, model)
        return self._kernels[model]


def load_scene(source: str | Path | dict[str, Any], *, settings: Settings | None = None) -> Scene:
    """Loads an .xml file, a Mitsuba dictionary or a gallery name.

    settings: only width and height matter here. Raises SceneError (or UnsupportedScene) with place and cause.
    """
    asked = settings or Settings()
    parsed = parse(source)
    requirements = measure(parsed)
    rewrite.resize(parsed.state, asked.width, asked.height)
    rewrite.neutralise_integrators(parsed.state)
    made = instantiate(parsed)
    if not made.sensors():
        raise SceneError(f"{parsed.name}: the scene has no sensor")
    size = made.sensors()[0].film().crop_size()
    width, height = int(size[0]), int(size[1])
    rewrite.check_size(width, height)
    return Scene(source, parsed.name, parsed.digest, width, height, requirements, made)
