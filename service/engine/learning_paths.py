"""Runs inside a render process: paths and points on lights for the Learn view, and where they lie in the picture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from service.engine.learning import Pixel, lesson_of
from service.engine.turn import Failure
from service.engine.worker import failure_of

PATHS = 16  # told together


def paths(pixel: Pixel, first: int) -> dict[str, Any] | Failure:
    """Paths number `first` … `first + PATHS` from the pixel's centre, vertex by vertex."""
    try:
        from renderer.lesson.projection import Projection
        from renderer.lesson.walk import walk

        lesson = lesson_of(pixel)
        scene = lesson.scene
        projection = Projection(scene.sensor, scene.width, scene.height)
        steps = walk(lesson, range(first, first + PATHS))
        places = [projection.place(step.position) for step in steps]
        # Of a ray that leaves the scene, a point so far out that it is beyond the picture's edge; nearer if that is
        # behind the camera.
        box = scene.mitsuba_scene.bbox()
        far = 2 * float(np.linalg.norm(np.array(box.max, float).ravel() - np.array(box.min, float).ravel()) or 1.0)
        told = []
        for path in range(PATHS):
            vertices = []
            for step, place in zip(steps, places, strict=True):
                if not step.is_there[path]:
                    break
                is_sky = bool(step.is_sky[path])
                at = place[path]
                if is_sky:
                    ways = far * 0.5 ** np.arange(24)
                    on_ray = projection.place(step.position[path] + ways[:, None] * step.direction[path])
                    at = on_ray[int(np.isfinite(on_ray[:, 0]).argmax())]
                original = scene.similarity.original_position(step.position[path])
                vertices.append(
                    {
                        "position": None if is_sky else [float(value) for value in original],
                        "column": _known(at[0]),
                        "row": _known(at[1]),
                        "is_sky": is_sky,
                        "is_seen": bool(step.is_seen[path]),
                        "direction": [float(value) for value in step.direction[path]],
                        "distance": _known(float(scene.similarity.original_distance(step.distance[path]))),
                        "emitted": float(step.emitted[path]),
                        "throughput": float(step.throughput[path]),
                        "added": float(step.added[path]),
                        "cos_theta": None if is_sky else abs(float(step.cos_theta[path])),
                        "pdf": None if is_sky else _known(float(step.pdf[path])),
                        "f_cos": None if is_sky else _known(float(step.f_cos[path])),
                    }
                )
            told.append({"number": first + path, "vertices": vertices, "sum": sum(v["added"] for v in vertices)})
        return {"paths": told, "is_placed": projection.is_known}
    except Exception as error:
        return failure_of(error)


def light_points(pixel: Pixel, n: int) -> dict[str, Any] | Failure:
    """Points on the lights with each factor of the area form."""
    try:
        from renderer.lesson.projection import Projection
        from renderer.lesson.two_forms import light_points as drawn

        lesson = lesson_of(pixel)
        scene = lesson.scene
        found = drawn(lesson, n)
        if found is None:
            return {"points": [], "is_placed": False}
        projection = Projection(scene.sensor, scene.width, scene.height)
        places = projection.place(found.position)
        points = [
            {
                "column": _known(places[i, 0]),
                "row": _known(places[i, 1]),
                "has_area": bool(found.has_area[i]),
                "is_visible": bool(found.is_visible[i]),
                "distance": _known(found.distance[i]) if found.has_area[i] else None,
                "cos_theta": float(found.cos_theta[i]),
                "cos_light": _known(found.cos_light[i]),
                "geometry": _known(found.geometry[i]),
                "f": _known(found.f[i]),
                "emitted": _known(found.emitted[i]),
                "pdf": _known(found.pdf[i]),
                "pdf_area": _known(found.pdf_area[i]),
                "estimate": float(found.estimate[i]) if math.isfinite(found.estimate[i]) else 0.0,
            }
            for i in range(n)
        ]
        return {"points": points, "is_placed": projection.is_known}
    except Exception as error:
        return failure_of(error)


def _known(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
