"""What a picture of few pixels says in numbers: each value with its interval, as a meter's scale is read.

Enters: an estimate. Leaves: dictionaries for JSON, and lines for people; none where there are too many pixels to read.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from renderer.estimate.estimate import Estimate
from renderer.estimate.interval import t_quantile

MOST_READINGS = 256  # pixels whose values are given in numbers
MOST_LINES = 16  # and those that are printed
CHANNELS = ("R", "G", "B", "Y")
STOKES = tuple(f"S{i}.{colour}" for i in (1, 2, 3) for colour in "RGB")


def readings(estimate: Estimate, confidence: float = 0.95) -> list[dict[str, Any]] | None:
    """One dictionary a pixel, row by row: x, y, `value` and `half_width` of R, G, B, Y (None where not known) and,
    where light is polarised, of S1.R to S3.B, `replicates`, `trusted`. In the units of the sensor: radiance, or
    irradiance of an irradiance meter. None of pictures of over MOST_READINGS pixels.
    """
    if estimate.width * estimate.height > MOST_READINGS:
        return None
    moments = estimate.moments
    names = CHANNELS + STOKES if moments.has_stokes else CHANNELS
    values = np.concatenate([moments.mean, moments.luminance()[:, None], moments.stokes], axis=1)
    errors = estimate.stderr.reshape(len(values), -1)
    if (stokes := estimate.stokes_stderr) is not None:
        errors = np.concatenate([errors, stokes.reshape(len(values), -1)[:, 3:]], axis=1)
    widths = errors * t_quantile(0.5 + confidence / 2, np.maximum(moments.count - 1, 1))[:, None]
    trusted = estimate.trust.ravel()
    return [
        {
            "x": i % estimate.width,
            "y": i // estimate.width,
            "value": dict(zip(names, map(_known, values[i]), strict=True)),
            "half_width": dict(zip(names, map(_known, widths[i]), strict=True)),
            "replicates": int(moments.count[i]),
            "trusted": bool(trusted[i]),
        }
        for i in range(len(values))
    ]


def lines(estimate: Estimate, confidence: float = 0.95) -> list[str]:
    """The readings as people read them; none of pictures of over MOST_LINES pixels."""
    if estimate.width * estimate.height > MOST_LINES:
        return []
    return [_line(one, estimate, confidence) for one in readings(estimate, confidence) or []]


def _line(reading: dict[str, Any], estimate: Estimate, confidence: float) -> str:
    place = "" if estimate.width * estimate.height == 1 else f"({reading['x']}, {reading['y']}): "
    if reading["replicates"] == 0:
        return place + "no sample yet"
    parts = [_said(c, reading["value"][c], reading["half_width"][c]) for c in CHANNELS]
    if len({part.split(" ", 1)[1] for part in parts[:3]}) == 1:  # grey
        parts = [parts[3].split(" ", 1)[1]]
    for i in range(0, len(STOKES), 3) if STOKES[0] in reading["value"] else ():
        of_it = [_said(c, reading["value"][c], reading["half_width"][c]) for c in STOKES[i : i + 3]]
        is_grey = len({part.split(" ", 1)[1] for part in of_it}) == 1
        parts += [of_it[0].replace(".R ", " ", 1)] if is_grey else of_it
    doubt = "" if reading["trusted"] else ", not trusted"
    return f"{place}{', '.join(parts)} with {100 * confidence:g} % confidence{doubt}"


def _said(channel: str, value: float | None, half: float | None) -> str:
    """A value with as many digits as its half width has to say; the half width with two."""
    if value is None:
        return f"{channel} unknown"
    if half is None:
        return f"{channel} {value:.6g}, interval not known yet"
    if half == 0 or value == 0:
        return f"{channel} {value:.7g} ± {half:.2g}"
    digits = max(1, min(9, 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(half))))
    return f"{channel} {value:.{digits}g} ± {half:.2g}"


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
