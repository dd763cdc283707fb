"""Runs an audit: whether a scene needs one, what is aimed at, light paths, camera paths, and their sums."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from renderer.audit.gather import LUMINANCE, NOTHING, Gathered, Gatherer
from renderer.audit.value import CLASSES, Audit, Source, class_of, coarse, edges
from renderer.backend import mitsuba, using
from renderer.equation.light_paths import Aim, Arrivals, LightPaths, shape_id
from renderer.equation.reach import is_specular, label
from renderer.equation.tables import table

if TYPE_CHECKING:
    from renderer.scene.compile import Scene
    from renderer.settings import Settings

BATCHES = 8  # independent ones: their spread is the audit's own error
LIGHT_PATHS = 2**14  # of a batch,
CAMERA_PATHS = 2**13  # and, about, of the camera
FEWER = 8  # times fewer of both tell whether all of them are worth their time:
FINDS = 3  # where they find light at least so often,
RARE_LIGHT = 1e-3  # and of what is met by fewer samples than this
LEAST_RARE = 3e-3  # so little, as root mean square over the tiles and of the image's mean, they are the audit
LEVEL_PIXELS = 256  # that tell the image's mean
TILES = 24  # on the longer side of the image
BLUR = 1 / 60  # of what the camera sees: radius within which light counts as spread out
PROBES = 32  # camera rays on a side, that tell how large that is
MOST_AIMS = 16  # balls around mirrors and glass, at which paths from the lights are aimed
SEED = 0xA0D1

Box = tuple[NDArray[np.float64], NDArray[np.float64]]


def audit(scene: Scene, settings: Settings) -> Audit | None:
    """What light the technique of resolved settings hardly finds. None where there can be none, told from the scene
    alone. Equal scenes, settings and seeds give equal bits."""
    from renderer.equation.path import NO_LIMIT

    if not is_needed(scene, settings):
        return None
    kernel = scene.kernel_of(scene.model(settings))
    with using(scene.variant):
        limit = int(np.array(kernel.sizes[3])[0])
        shortest = 1 if kernel.samples_emitters else 0
        longest = 64 if limit == NO_LIMIT else limit - 2
        paths = LightPaths(kernel.mitsuba_scene, kernel.rays, aim_of(scene, shortest), shortest, longest)
        if not paths.emitters:
            return None
        found, finds = _looked(scene, settings, kernel, paths, FEWER)
        if finds < FINDS or _may_hide(found, kernel, settings.seed):
            found, _ = _looked(scene, settings, kernel, paths, 1)
    return found


def _looked(scene: Scene, settings: Settings, kernel: Any, paths: LightPaths, fewer: int) -> tuple[Audit, int]:
    """An audit with so many times fewer paths, and how often they found light."""
    time = kernel.shutter_open + 0.5 * kernel.shutter_time
    seed = settings.seed ^ SEED
    arrivals = paths.arrivals(BATCHES, LIGHT_PATHS // fewer, seed, time)
    columns, rows = tiles_of(scene.width, scene.height)
    if len(arrivals.p):
        size = _seen_size(kernel, arrivals)
        per_tile = max(1, CAMERA_PATHS // fewer // (columns * rows))
        gatherer = Gatherer(kernel, _places(scene, columns, rows), arrivals, size * BLUR)
        found = gatherer.gather(BATCHES, per_tile, seed)
    else:
        per_tile, found = 1, NOTHING
    spectrum, m2, m2_coarse = _summed(found, columns, rows, per_tile)
    sources = _sources(scene, paths, arrivals, found, columns * rows * per_tile * BATCHES)
    made = Audit(scene.width, scene.height, columns, rows, BATCHES, spectrum, m2, sources, m2_coarse)
    return made, len(found.tile)


def _may_hide(found: Audit, kernel: Any, seed: int) -> bool:
    """Whether a notable part of the image may be light that samples hardly ever meet."""
    rare = found.rare(RARE_LIGHT)
    if not rare.any():
        return False
    size = float(np.sqrt(np.mean(np.square(rare))))
    if not np.isfinite(size):
        return True
    # What was audited is part of the image; where that does not tell, a few pixels say how bright all of it is.
    if size < LEAST_RARE * float(found.spectrum.sum(axis=1).mean()):
        return False
    n = found.width * found.height
    some = np.unique(np.linspace(0, n - 1, min(n, LEVEL_PIXELS)).astype(np.int64))
    with np.errstate(invalid="ignore"):
        level = float(np.asarray(LUMINANCE) @ np.nan_to_num(kernel.look(some, seed ^ SEED).finished()[0]).mean(axis=1))
    return size >= LEAST_RARE * level


def is_needed(scene: Scene, settings: Settings) -> bool:
    """Whether there may be light that the technique hardly finds: by way of mirrors or clear glass, or, where no points
    on lights are sampled, any. A sky of one colour is found by every direction. Not where there are media or polarised
    light: light paths know nothing of them."""
    needs = scene.requirements
    if needs.media or needs.polarised_by is not None:
        return False
    depth = scene.model(settings).max_depth
    if not needs.has_smooth or not set(needs.emitters) - {"constant"}:
        return False
    if settings.technique not in ("mis", "emitter"):
        return depth < 0 or depth >= 2
    with using(scene.variant):
        return (depth < 0 or depth >= 3) and bool(specular_shapes(scene))


def tiles_of(width: int, height: int) -> tuple[int, int]:
    """Columns and rows of tiles, about square ones."""
    side = max(width, height) / TILES
    return (max(1, min(width, round(width / side))), max(1, min(height, round(height / side))))


def _places(scene: Scene, columns: int, rows: int) -> NDArray[np.float64]:
    """(tiles, 4) corner and size of each, as shares of the image."""
    x, y = edges(scene.width, columns) / scene.width, edges(scene.height, rows) / scene.height
    corner_y, corner_x = np.meshgrid(y[:-1], x[:-1], indexing="ij")
    size_y, size_x = np.meshgrid(np.diff(y), np.diff(x), indexing="ij")
    return np.stack([a.ravel() for a in (corner_x, corner_y, size_x, size_y)], axis=1)


# ------------------------------ Where to look ------------------------------


def specular_shapes(scene: Scene) -> list[Any]:
    """Shapes that are mirrors or clear glass, in part at least; of what instances hold is known that some may be."""
    may_be_inside = scene.requirements.has_delta or scene.requirements.has_null
    return [
        shape
        for shape in scene.mitsuba_scene.shapes()
        if (may_be_inside if shape.class_name() == "Instance" else is_specular(shape.bsdf()))
    ]


def aim_of(scene: Scene, shortest: int) -> Aim:
    """At the bounds of mirrors and glass, or of the scene where light that is seen directly counts as well."""
    every = list(scene.mitsuba_scene.shapes())
    low, high = _bounds(every)
    middle = 0.5 * (low + high)
    # Where all mirrors and glass are beyond what floats hold, as at the scene.
    boxes = (_boxes(specular_shapes(scene)) if shortest else []) or [(low, high)]
    boxes = _joined(sorted(boxes, key=lambda box: (*box[0], *box[1])), MOST_AIMS)  # not as they were loaded
    centres = np.array([0.5 * (a + b) for a, b in boxes])
    radii = np.array([0.5 * float(np.linalg.norm(b - a)) * 1.001 for a, b in boxes])
    whole = 0.5 * float(np.linalg.norm(high - low))
    return Aim(centres, np.maximum(radii, 1e-6 * whole), (float(middle[0]), float(middle[1]), float(middle[2])), whole)


def _joined(boxes: list[Box], most: int) -> list[Box]:
    """The same with those that lie side by side made one, until there are `most` of them: halves of halves."""
    groups = [boxes]
    while len(groups) < most and any(len(group) > 1 for group in groups):
        widest = max((g for g in groups if len(g) > 1), key=lambda g: float(np.max(np.subtract(*_around(g)[::-1]))))
        axis = int(np.argmax(np.subtract(*_around(widest)[::-1])))
        ordered = sorted(widest, key=lambda box: float(box[0][axis] + box[1][axis]))
        groups = [g for g in groups if g is not widest] + [ordered[: len(ordered) // 2], ordered[len(ordered) // 2 :]]
    return [_around(group) for group in groups]


def _around(boxes: list[Box]) -> Box:
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)


def _bounds(shapes: list[Any]) -> Box:
    """Low and high corner."""
    return _around(_boxes(shapes) or [(np.zeros(3), np.zeros(3))])


def _boxes(shapes: list[Any]) -> list[Box]:
    """Low and high corner of each; of meshes by their vertices, for merged ones have no bounds in Mitsuba 3.9."""
    boxes = []
    for shape in shapes:
        if shape.is_mesh():
            points = np.array(shape.vertex_positions_buffer(), np.float64).reshape(-1, 3)
        else:
            points = np.array([shape.bbox().min, shape.bbox().max], np.float64).reshape(2, 3)
        if len(points) and np.isfinite(points).all():
            boxes.append((points.min(axis=0), points.max(axis=0)))
    return boxes


def _seen_size(kernel: Any, arrivals: Arrivals) -> float:
    """Extent of what the camera sees first, without far outliers; if that is nothing, of where light came to lie."""
    points = first_points(kernel.camera, kernel.mitsuba_scene, kernel.shutter_open)
    return extent_of(points if len(points) >= 2 else arrivals.p.astype(np.float64))


def first_points(camera: Any, scene: Any, time: float) -> NDArray[np.float64]:
    """(n, 3) places that a grid of camera rays meets first."""
    si = scene.ray_intersect(probe_rays(camera, time))
    return np.array(si.p, np.float64).T.reshape(-1, 3)[np.array(si.is_valid()).ravel()]


def probe_rays(camera: Any, time: float) -> Any:
    """A grid of rays over the image."""
    mi = mitsuba()
    i = np.arange(PROBES * PROBES)
    at = mi.Point2f(*(table((n + 0.5) / PROBES, mi.Float) for n in (i % PROBES, i // PROBES)))
    return camera.sample_ray(time, 0.5, at, mi.Point2f(0.5), True)[0]


def extent_of(points: NDArray[np.float64]) -> float:
    """On the longest side, without far outliers; never zero."""
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    return max(float(np.max(high - low)), 1e-6 * float(np.abs(points).max()), 1e-30)


# ------------------------------ Sums ------------------------------


def _summed(found: Gathered, columns: int, rows: int, per_tile: int) -> tuple[NDArray[np.float64], ...]:
    """(tiles, CLASSES + 1) mean luminance by class, and squared deviations of the batches' totals in each tile and in
    each block of tiles."""
    tiles = columns * rows
    cell = found.tile * (CLASSES + 1) + class_of(found.worth)
    share = found.luminance / per_tile
    spectrum = np.bincount(cell, share, minlength=tiles * (CLASSES + 1)).reshape(tiles, -1) / BATCHES
    totals: NDArray[np.float64] = (
        np.bincount(found.batch * tiles + found.tile, share.astype(np.float64), minlength=BATCHES * tiles)
        .reshape(BATCHES, -1)
        .astype(np.float64)
    )
    of_blocks = np.stack([coarse(total, columns, rows) for total in totals])
    return spectrum, _squares(totals), _squares(of_blocks)


def _squares(batches: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.square(batches - batches.mean(axis=0)).sum(axis=0)


def _sources(
    scene: Scene, paths: LightPaths, arrivals: Arrivals, found: Gathered, camera_paths: int
) -> tuple[Source, ...]:
    """Which light, by way of what, the most luminous first."""
    light, via = arrivals.light[found.arrival].astype(np.int64), arrivals.via[found.arrival].astype(np.int64)
    names = {shape_id(shape): shape for shape in scene.mitsuba_scene.shapes()}
    sums: dict[tuple[str, str], list[tuple[float, float]]] = {}
    width = int(via.max(initial=0)) + 1
    pair, n = light * width + via, width * len(paths.emitters)
    energy = np.bincount(pair, found.luminance, minlength=n) / camera_paths
    rate = np.bincount(pair, found.luminance / found.worth, minlength=n) / camera_paths
    lights = [label(e) for e in paths.emitters]
    for both in np.flatnonzero(energy):
        number, shape = divmod(int(both), width)
        key = lights[number], surface_name(names.get(shape)) if shape else ""
        sums.setdefault(key, []).append((float(energy[both]), float(rate[both])))
    # Exact sums: the numbers of shapes, and so their order, vary from one loading to the next.
    made = (Source(*key, *map(math.fsum, zip(*parts, strict=True))) for key, parts in sums.items())
    made = (source for source in made if math.isfinite(source.energy))
    return tuple(sorted(made, key=lambda s: (-s.energy, s.light, s.via)))


def surface_name(shape: Any) -> str:
    """How to call a mirror or a pane."""
    name = "" if shape is None else str(shape.id())
    return f"'{name}'" if name and not name.startswith("_") else "clear glass or mirrors"
