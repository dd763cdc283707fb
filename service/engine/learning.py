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
from service.pixels import png_bytes

_PICTURE_PIXELS, _PICTURE_SPP = 1 << 16, 32

if TYPE_CHECKING:
    from renderer.lesson.pixel import Lesson


@dataclass(frozen=True, slots=True)
class Pixel:
    """A pixel of a scene, at the scene's own size. scene: a gallery name, or a file."""

    scene: str
    x: int
    y: int


def lesson_of(pixel: Pixel) -> Lesson:
    """The renderer's lesson at a pixel; raises what loading its scene raises."""
    import renderer
    from renderer.lesson.pixel import Lesson

    return Lesson(kept_scene(pixel.scene, renderer.Settings(colour="rgb")), pixel.x, pixel.y)


def vertex(pixel: Pixel, n: int) -> dict[str, Any] | Failure:
    """The first vertex, and `n` directions of each technique there."""
    try:
        from renderer.lesson.pixel import TECHNIQUES

        lesson = lesson_of(pixel)
        found = lesson.vertex
        answer = asdict(found) | {"width": lesson.scene.width, "height": lesson.scene.height, "directions": {}}
        answer |= {"map_width": 0, "map_height": 0, "polar_range": 0.0, "camera_u": 0.0, "camera_v": 0.0}
        if not found.is_hit:
            return answer
        answer["map_width"], answer["map_height"] = lesson.map_size
        answer["polar_range"] = lesson.polar_range
        answer["camera_u"], answer["camera_v"] = lesson.camera_direction
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
        from renderer.lesson.pixel import REPLICATE_SIZE

        lesson = lesson_of(pixel)
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
        return _frame(mean, error, moments.count.reshape(rows, columns), replicates, REPLICATE_SIZE)
    except Exception as error:
        return failure_of(error)


def kernel(pixel: Pixel) -> bytes | Failure | None:
    """f·cosθ over the map as a frame: exact, without an error. None where nothing is hit."""
    try:
        lesson = lesson_of(pixel)
        if not lesson.vertex.is_hit:
            return None
        value = lesson.integrand()
        rows, columns, _ = value.shape
        error = np.zeros((rows, columns, 4))
        return _frame(value, error, np.ones((rows, columns)), 1, 1)
    except Exception as error:
        return failure_of(error)


def _frame(mean: Any, error: Any, count: Any, seq: int, replicate_size: int) -> bytes:
    shown = Display(
        seq=seq,
        replicate_size=replicate_size,
        seconds=0.0,
        radiance=mean.astype(np.float32),
        standard_error=error.astype(np.float32),
        replicates=count.astype(np.uint32),
        trusted=np.ones(count.shape, np.bool_),
    )
    return encode_frame(shown)


def bounces(pixel: Pixel, first: int, count: int) -> dict[str, Any] | Failure:
    """Moments of the pixel's luminance by the number of reflections, over samples `first` … `first + count`."""
    try:
        from renderer.lesson.bounces import by_bounces
        from renderer.lesson.pixel import moments_of

        *terms, more = by_bounces(lesson_of(pixel), range(first, first + count))
        reflected = np.sum(terms[1:], axis=0) + more
        told = {"more": more, "reflected": reflected, "total": terms[0] + reflected}
        return {"terms": [asdict(moments_of(term)) for term in terms]} | {
            name: asdict(moments_of(values)) for name, values in told.items()
        }
    except Exception as error:
        return failure_of(error)


def samples(
    pixel: Pixel, technique: str, first: int, count: int, max_depth: int | None
) -> list[dict[str, float]] | Failure:
    """Running moments of the pixel's luminance over samples `first` … `first + count`, at geometric steps."""
    try:
        from renderer.lesson.pixel import running

        values = lesson_of(pixel).samples(technique, range(first, first + count), max_depth=max_depth)
        steps = running(np.where(np.isfinite(values), values, 0.0), first)
        return [asdict(step) for step in steps if math.isfinite(step.m4)]
    except Exception as error:
        return failure_of(error)


def picture(scene: str) -> bytes | Failure:
    """A small picture, PNG, to find one's way in."""
    try:
        import renderer

        loaded = kept_scene(scene, renderer.Settings())
        shrink = min(1.0, math.sqrt(_PICTURE_PIXELS / (loaded.width * loaded.height)))
        width, height = (max(1, round(shrink * side)) for side in (loaded.width, loaded.height))
        settings = renderer.Settings(width=width, height=height, replicate_size=4)
        estimate = renderer.render(loaded.sized(settings), renderer.Target(spp=_PICTURE_SPP), settings)
        return png_bytes(estimate.mean.astype(np.float32), 0.0)
    except Exception as error:
        return failure_of(error)
