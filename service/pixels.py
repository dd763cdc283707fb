"""One pixel with its error bars, and the picture as PNG."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.interval import t_quantile
from renderer.image.picture import ToneMap, to_srgb8, with_alpha
from renderer.image.png import encode_png
from service.display import Display
from service.messages import Pixel

# Rec. 709
_LUMINANCE = (0.2126, 0.7152, 0.0722)


def read_pixel(display: Display, x: int, y: int) -> Pixel:
    """Column x, row y of a display.

    The interval is Student's t with one degree of freedom less than replicates.
    """
    value = [float(v) for v in display.radiance[y, x]]
    errors = [float(e) for e in display.standard_error[y, x]]
    replicates = int(display.replicates[y, x])
    luminance = sum(weight * v for weight, v in zip(_LUMINANCE, value, strict=True))
    interval = None
    if replicates >= 2 and np.isfinite(errors[3]) and np.isfinite(luminance):
        half_width = float(t_quantile(0.975, replicates - 1)) * errors[3]
        interval = [luminance - half_width, luminance + half_width]
    return Pixel(
        x=x,
        y=y,
        value=[_finite(v) for v in value],
        standard_error=[_finite(e) if replicates >= 2 else None for e in errors],
        luminance=_finite(luminance),
        interval=interval,
        samples=replicates * display.replicate_size,
        replicates=replicates,
        trusted=bool(display.trusted[y, x]),
    )


def png_bytes(
    radiance: NDArray[np.float32], exposure: float, tone: ToneMap = "srgb", alpha: NDArray[np.float32] | None = None
) -> bytes:
    """An 8-bit sRGB PNG of (H, W, 3) radiance, transparent where alpha, (H, W), says so."""
    picture = to_srgb8(radiance, exposure, tone) if alpha is None else with_alpha(radiance, alpha, exposure, tone)
    return encode_png(picture)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
