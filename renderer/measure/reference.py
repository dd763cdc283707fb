"""A converged image to measure true errors against: an EXR of ours, or of any other renderer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer.errors import CheckpointError, SettingsError
from renderer.estimate.error import pixel_rel_mse, rel_mse
from renderer.estimate.estimate import Estimate
from renderer.settings import Settings

if TYPE_CHECKING:
    from renderer.scene.compile import Scene


@dataclass(frozen=True)
class Reference:
    """mean: (H, W, 3) radiance. noise: what the reference's own error adds to a relMSE, 0 where it is not known.

    digest: of its scene; None for an image that is not ours.
    """

    path: Path
    mean: NDArray[np.float64]
    noise: float
    digest: str | None

    @staticmethod
    def read(path: Path) -> Reference:
        """Reads an EXR. Raises SettingsError where there is none, or it has no R, G and B."""
        if not path.is_file():
            raise SettingsError(f"--reference is {path}; there is no such file")
        try:
            ours = Estimate.read(path)
        except CheckpointError:
            return Reference(path, _read_rgb(path), 0.0, None)
        noise = float(np.nanmean(pixel_rel_mse(ours.moments)))
        return Reference(path, ours.mean, noise if math.isfinite(noise) else 0.0, ours.identity.scene)

    def size_for(self, asked: Settings) -> dict[str, int]:
        """The size to render at: the reference's. Raises SettingsError where another was asked."""
        height, width = self.mean.shape[:2]
        if asked.width not in (None, width) or asked.height not in (None, height):
            raise SettingsError(
                f"the reference {self.path.name} has {width}×{height} pixels, asked is "
                f"{asked.width}×{asked.height}; leave --size out to measure at the reference's"
            )
        return {"width": width, "height": height}

    def check(self, scene: Scene) -> None:
        """Refuses an estimate of ours that is of another scene."""
        if self.digest is not None and self.digest != scene.digest:
            raise SettingsError(
                f"the reference {self.path.name} is of another scene (digest {self.digest[:12]}) than {scene.name} "
                f"({scene.digest[:12]})"
            )

    def error_of(self, image: NDArray[np.float64]) -> float:
        """True relative error of an image, (H, W, 3): the root of its relMSE, the reference's own part taken off."""
        return math.sqrt(max(0.0, rel_mse(image, self.mean) - self.noise))


def _read_rgb(path: Path) -> NDArray[np.float64]:
    import OpenImageIO as oiio

    found: Any = oiio.ImageInput.open(str(path))
    if found is None:
        raise SettingsError(f"--reference is {path}; it cannot be read as an image: {oiio.geterror()}")
    try:
        spec = found.spec()
        names = list(spec.channelnames)
        if not all(channel in names for channel in "RGB"):
            raise SettingsError(f"--reference is {path}; it has the channels {', '.join(names)}, and not R, G and B")
        pixels = np.asarray(found.read_image(oiio.FLOAT), dtype=np.float64)
        pixels = pixels.reshape(spec.height, spec.width, len(names))
        return pixels[..., [names.index(channel) for channel in "RGB"]]
    finally:
        found.close()
