"""Runs inside a render process: what the Learn view asks of one pixel. Plain values in and out."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from service.display import Display
from service.engine.turn import Failure
from service.engine.worker import failure_of, kept_scene
from service.frames import encode_frame

if TYPE_CHECKING:
    from renderer.measure.learn import Lesson


@dataclass(frozen=True, slots=True)
class Pixel:
    """A pixel of a scene of the gallery, at the scene's own size."""

    scene: str
    x: int
    y: int


def _lesson(pixel: Pixel) -> Lesson:
    import renderer
    from renderer.measure.learn import Lesson

    return Lesson(kept_scene(pixel.scene, renderer.Settings(colour="rgb")), pixel.x, pixel.y)


def vertex(pixel: Pixel, n: int) -> dict[str, Any] | Failure:
    """The first vertex, and `n` directions of each technique there."""
    try:
        from renderer.measure.learn import TECHNIQUES

        lesson = _lesson(pixel)
        found = lesson.vertex
        answer = asdict(found) | {"width": lesson.scene.width, "height": lesson.scene.height, "directions": {}}
        answer |= {"map_width": 0, "map_height": 0, "polar_range": 0.0}
        if not found.is_hit:
            return answer
        answer["map_width"], answer["map_height"] = lesson.map_size
        answer["polar_range"] = lesson.polar_range
        for technique in TECHNIQUES[:-1]:
            drawn = lesson.directions(technique, n)
            answer["directions"][technique] = {
                "u": [round(float(u), 5) for u in drawn.u],
                "v": [round(float(v), 5) for v in drawn.v],
                "found": None if drawn.found is None else [bool(hit) for hit in drawn.found],
                "lost": drawn.lost,
            }
        return answer
    except Exception as error:
        return failure_of(error)


def incident(pixel: Pixel, replicates: int, is_weighted: bool) -> bytes | Failure | None:
    """The map of arriving radiance as a frame; weighted by f·cosθ if asked. None where nothing is hit."""
    try:
        from renderer.measure.learn import REPLICATE_SIZE

        lesson = _lesson(pixel)
        if not lesson.vertex.is_hit:
            return None
        moments = lesson.incident(range(replicates))
        columns, rows = lesson.map_size
        mean = moments.mean.reshape(rows, columns, 3)
        error = np.sqrt(moments.variance_of_mean()).reshape(rows, columns, 4)
        if is_weighted:
            weight = lesson.integrand()
            mean = mean * weight
            error = np.concatenate([error[..., :3] * weight, error[..., 3:]], axis=-1)
            # Channels vary together, in an unknown measure: never more than this.
            error[..., 3] = error[..., :3] @ [0.2126, 0.7152, 0.0722]
        count = moments.count.reshape(rows, columns)
        shown = Display(
            seq=replicates,
            replicate_size=REPLICATE_SIZE,
            seconds=0.0,
            radiance=mean.astype(np.float32),
            standard_error=error.astype(np.float32),
            replicates=count.astype(np.uint32),
            trusted=np.ones((rows, columns), np.bool_),
        )
        return encode_frame(shown)
    except Exception as error:
        return failure_of(error)


def samples(pixel: Pixel, technique: str, first: int, count: int) -> list[dict[str, float]] | Failure:
    """Running moments of the pixel's luminance over samples `first` … `first + count`, at geometric steps."""
    try:
        from renderer.measure.learn import running

        values = _lesson(pixel).samples(technique, range(first, first + count))
        steps = running(np.where(np.isfinite(values), values, 0.0), first)
        return [{"n": n, "mean": mean, "m2": m2} for n, mean, m2 in steps if math.isfinite(m2)]
    except Exception as error:
        return failure_of(error)
