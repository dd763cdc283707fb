"""The environment map as patches of sky, each sampled here instead of by a call to its plugin.

Enters: Mitsuba's `envmap`. Leaves: patches that stand beside the other lights in the choice among them, so that the
patches which a place cannot see, behind its horizon or a wall, are hardly ever asked; and within a patch directions in
proportion to the radiance, with their density. Texels are interpolated as Mitsuba does: columns lie in the middle of
their share of the circle, the first and the last row on the poles.
Sources: pbrt-v4, sections A.5 (bilinear and tabulated distributions) and 12.5 (environment maps); Karlík, Šik, Vévoda,
Skřivan & Křivánek 2019 (MIS compensation).
"""

from __future__ import annotations

import copy
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.group import Hit, Spot
from renderer.equation.mueller import intensity
from renderer.equation.tables import last_up_to, number, table
from renderer.estimate.moments import LUMINANCE

mi: Any = mitsuba()

ENVIRONMENT_MAP = "EnvironmentMapEmitter"  # Mitsuba's name of the class
PATCH_ROWS, PATCH_COLUMNS = 8, 16
MOST_TEXELS = 2**21  # of larger maps a smaller image says where to look, and the plugin what is there
PROBES, TOLERANCE = 256, 1e-3  # directions in which the plugin is asked, and how far answers may differ
EVEN = 0.05  # share of the power above the mean, below which a map is even
DARKEST = 1e-12  # share of a patch without light: what is chosen has a probability
ONE_MINUS_EPSILON = 1 - 2**-24


class EnvironmentMap:
    """shares: (n_patches,) of what is sampled, none of them zero. Rows run from the pole +y to −y, columns around it.

    texels: (height, width, 3). rotation: from the map to the world. is_compensated: see `_compensated`. plugin: to ask
    for the radiance, where texels say it only about.
    As a group of lights (`group.py`), its rows are its patches.
    """

    tells_radiance = True

    def __init__(
        self,
        scene: Any,
        texels: NDArray[np.float32],
        rotation: NDArray[np.float64],
        is_compensated: bool,
        plugin: Any = None,
    ) -> None:
        self._plugin = plugin
        self.height, self.width = texels.shape[:2]
        sines = np.sin(np.arange(self.height) * np.pi / (self.height - 1))
        luminance: NDArray[np.float64] = np.asarray(np.abs(texels) @ LUMINANCE, np.float64)
        needs_poles = _is_lit_from_a_pole_alone(luminance)
        if is_compensated:
            luminance = _compensated(luminance, sines)
        weights = luminance * sines[:, None]
        if needs_poles or not (weights[1:-1] > 0).any():
            sines[[0, -1]] = np.sin(np.pi / 4 / (self.height - 1))
            weights = luminance * sines[:, None]
            weights /= weights[1:-1].sum() + 0.5 * weights[[0, -1]].sum()
        else:
            weights /= weights[:-1].sum()  # of which each is a quarter of four cells
        wrapped = np.concatenate([weights, weights[:, :1]], axis=1)
        mass = 0.25 * (wrapped[:-1, :-1] + wrapped[:-1, 1:] + wrapped[1:, :-1] + wrapped[1:, 1:])
        self._divide(mass, PATCH_ROWS, PATCH_COLUMNS)
        known = np.empty((self.height, self.width + 1, 4), np.float32)  # the first column once more behind the last
        known[:, :-1, :3], known[:, :-1, 3] = texels, weights
        known[:, -1] = known[:, 0]
        self._texels = table(known.ravel(), mi.Float)
        self._rotation = [[number(v) for v in row] for row in rotation]
        box = scene.bbox()
        middle, low = (np.nan_to_num(np.array(v, np.float64).ravel(), posinf=0) for v in (box.center(), box.min))
        self._middle, self._radius = (
            [number(v) for v in middle],
            number(max(float(np.linalg.norm(middle - low)), 1e-4)),
        )

    def _divide(self, mass: NDArray[np.float64], down: int, around: int) -> None:
        """Into patches of `tall` × `wide` cells between four texels, the last ones of what is left.

        mass: (rows, columns) of the cells, 1 in all.
        """
        rows, columns = mass.shape
        self._mass = mass.astype(np.float32)
        self.tall, self.wide = -(-rows // down), -(-columns // around)
        self.patches_down, self.patches_around = -(-rows // self.tall), -(-columns // self.wide)
        self.n_patches = self.patches_down * self.patches_around
        padded = np.zeros((self.patches_down * self.tall, self.patches_around * self.wide))
        padded[:rows, :columns] = mass
        cells = padded.reshape(self.patches_down, self.tall, self.patches_around, self.wide).swapaxes(1, 2)
        cells = cells.reshape(self.n_patches, self.tall, self.wide)
        of_rows = cells.sum(axis=2)
        of_patches = of_rows.sum(axis=1)
        self.shares = np.maximum(of_patches, DARKEST)
        self._rows = table(_before(of_rows).ravel(), mi.Float)
        self._columns = table(_before(cells).ravel(), mi.Float)
        # From a weight to a density: cells are of equal size in both angles.
        per_angle = rows * columns / (2 * np.pi**2)
        self._scales = table(per_angle / self.shares, mi.Float)

    def undivided(self) -> EnvironmentMap:
        """The same as a single patch."""
        other = copy.copy(self)
        other._divide(self._mass.astype(np.float64), 1, 1)
        return other

    @classmethod
    def of(cls, scene: Any, emitters: list[Any], is_compensated: bool) -> EnvironmentMap | None:
        """That of a scene, if its map is among the emitters and is one that can be sampled here."""
        found = [emitter for emitter in emitters if emitter.class_name() == ENVIRONMENT_MAP]
        if not found or mi.is_spectral:
            return None
        known = mi.traverse(found[0])
        padded = np.array(known["data"], np.float32)  # with a column more on either side
        texels = padded[:, 1:-1, :] * np.float32(np.array(known["scale"]).ravel()[0])
        if texels.shape[2] not in (1, 3):
            return None
        if not np.isfinite(texels).all() or not texels.any():
            return None
        rotation = np.array(known["to_world"].matrix, np.float64).reshape(4, 4)[:3, :3]
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5):
            return None
        is_large = texels[..., 0].size > MOST_TEXELS
        if is_large:
            texels = _smaller(texels)
        texels = np.broadcast_to(texels, (*texels.shape[:2], 3))
        made = cls(scene, texels, rotation, is_compensated, found[0] if is_large else None)
        return made if made._plugin is not None or made._agrees_with(found[0]) else None

    def spot(self, direction: Any, active: Any) -> Spot:
        """Where a direction of the world, away from the scene, meets the map."""
        local: list[Any] = [sum(self._rotation[i][j] * direction[i] for i in range(3)) for j in range(3)]
        sine = dr.sqrt(dr.square(local[0]) + dr.square(local[2]))
        x = dr.atan2(local[0], -local[2]) * (self.width / (2 * np.pi)) - 0.5
        x = dr.select(x < 0, x + self.width, x)
        y = dr.maximum(dr.atan2(sine, local[1]), 0) * ((self.height - 1) / np.pi)
        column = dr.minimum(mi.UInt32(dr.maximum(x, 0)), self.width - 1)
        row = dr.minimum(mi.UInt32(y), self.height - 2)
        found = _bilinear(self._corners(row, column, active), x - mi.Float(column), y - mi.Float(row))
        patch = (row // self.tall) * self.patches_around + column // self.wide if self.n_patches > 1 else mi.UInt32(0)
        return Spot(patch, self._radiance(found, direction, active), self._density(found.w, patch, sine, active))

    def sample(self, ref: Any, patch: Any, emitter: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """A direction within a patch. Returns (DirectionSample3f, radiance / pdf)."""
        first_row = (patch // self.patches_around) * self.tall
        first_column = (patch - (patch // self.patches_around) * self.patches_around) * self.wide
        inner_row, u_y = _found(self._rows, patch * self.tall, self.tall, u.y, active)
        inner_column, u_x = _found(self._columns, (patch * self.tall + inner_row) * self.wide, self.wide, u.x, active)
        row = dr.minimum(first_row + inner_row, self.height - 2)
        column = dr.minimum(first_column + inner_column, self.width - 1)
        corners = self._corners(row, column, active)
        up, down = corners[0].w + corners[1].w, corners[2].w + corners[3].w
        y = _linear(up, down, u_y)
        left, right = dr.lerp(corners[0].w, corners[2].w, y), dr.lerp(corners[1].w, corners[3].w, y)
        x = _linear(left, right, u_x)
        found = _bilinear(corners, x, y)

        sine, cosine = dr.sincos((mi.Float(row) + y) * (np.pi / (self.height - 1)))
        sine_around, cosine_around = dr.sincos((mi.Float(column) + x + 0.5) * (2 * np.pi / self.width))
        local = (sine * sine_around, cosine, -sine * cosine_around)
        ds = dr.zeros(mi.DirectionSample3f)
        ds.d = mi.Vector3f(*(sum(self._rotation[i][j] * local[j] for j in range(3)) for i in range(3)))
        ds.n = -ds.d
        ds.dist = 2 * dr.maximum(self._radius, dr.norm(ref.p - mi.Point3f(*self._middle)))
        ds.p = ref.p + ds.d * ds.dist
        ds.emitter = emitter
        density = self._density(found.w, patch, sine, active)
        ds.pdf = dr.select(active & (density > 0) & dr.isfinite(density), density, 0)
        return ds, dr.select(ds.pdf > 0, self._radiance(found, ds.d, ds.pdf > 0) / ds.pdf, 0)

    def pdf(self, ref: Any, ds: Any, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.pdf`."""
        assert hit.spot is not None
        return hit.spot.density

    def emission(self, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.emission`."""
        assert hit.spot is not None
        return hit.spot.radiance

    def _radiance(self, found: Any, direction: Any, active: Any) -> Any:
        if self._plugin is None:
            return mi.UnpolarizedSpectrum(found.x) if mi.is_monochromatic else mi.Color3f(found.x, found.y, found.z)
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = -direction
        return intensity(self._plugin.eval(si, active))

    def _density(self, weight: Any, patch: Any, sine: Any, active: Any) -> Any:
        return dr.select(sine > 0, weight * dr.gather(mi.Float, self._scales, patch, active) / sine, 0)

    def _corners(self, row: Any, column: Any, active: Any) -> list[Any]:
        at = row * (self.width + 1) + column
        return [
            dr.gather(mi.Vector4f, self._texels, at + further, active)
            for further in (0, 1, self.width + 1, self.width + 2)
        ]

    def _agrees_with(self, emitter: Any) -> bool:
        """Whether the plugin says the same of some directions."""
        rng = np.random.default_rng(1)
        directions = rng.normal(size=(3, PROBES))
        directions /= np.linalg.norm(directions, axis=0)
        d = mi.Vector3f(*(table(axis, mi.Float) for axis in directions))
        si = dr.zeros(mi.SurfaceInteraction3f, PROBES)
        si.wi = -d
        theirs, ours = intensity(emitter.eval(si)), self.spot(d, mi.Bool(True)).radiance
        near = np.abs(np.array(theirs) - np.array(ours)) <= TOLERANCE * (np.abs(np.array(theirs)) + np.mean(theirs))
        return bool(near.mean() > 0.99)  # a texel's edge may fall to either side


def is_lit(emitter: Any) -> bool:
    """Whether a map has light that can be sampled: without any off the poles, Mitsuba's plugin has a density of NaN."""
    data = np.array(mi.traverse(emitter)["data"], np.float32)
    light = data[..., -1:] if mi.is_spectral else data  # there a scale goes with the shape of the spectrum
    return bool(light[1:-1].any()) or (bool(light.any()) and not mi.is_spectral)


def _is_lit_from_a_pole_alone(luminance: NDArray[np.float64]) -> bool:
    """Whether the row of a pole is bright beside texels without light: by the sines of rows alone nothing there would
    ever be sampled."""
    wrapped = np.concatenate([luminance, luminance[:, :1]], axis=1) > 0
    cells = wrapped[:, :-1] | wrapped[:, 1:]
    return bool((cells[0] & ~cells[1]).any() or (cells[-1] & ~cells[-2]).any())


def _smaller(texels: NDArray[np.float32]) -> NDArray[np.float32]:
    """An image of at most MOST_TEXELS, each the mean of those that lie nearest to it: none has light without it."""
    height, width = texels.shape[:2]
    factor = int(np.ceil(np.sqrt(height * width / MOST_TEXELS)))
    down, around = max(3, height // factor), max(3, width // factor)
    rows = np.rint(np.arange(height) * (down - 1) / (height - 1)).astype(np.int64)
    columns = np.rint((np.arange(width) + 0.5) * around / width - 0.5).astype(np.int64)
    sums = np.add.reduceat(np.add.reduceat(texels, _starts(rows), axis=0), _starts(columns), axis=1)
    return (sums / (np.bincount(rows)[:, None] * np.bincount(columns))[..., None]).astype(np.float32)


def _starts(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where each number begins in a sorted list."""
    return np.flatnonzero(np.diff(numbers, prepend=-1))


def _compensated(luminance: NDArray[np.float64], sines: NDArray[np.float64]) -> NDArray[np.float64]:
    """What lies above the mean of the sphere, for the rest is left to direction sampling: where both techniques are
    weighted (`mis`), that finds an even sky well enough, and a light's sample goes to the sun. An even map is kept.
    """
    mean = float((luminance * sines[:, None]).sum() / (sines.sum() * luminance.shape[1]))
    above = np.maximum(luminance - mean, 0)
    share = float((above * sines[:, None]).sum() / max((luminance * sines[:, None]).sum(), np.finfo(np.float64).tiny))
    return above if share >= EVEN else luminance


def _before(masses: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., n) masses → the share of them that lies before each. What has none is never the last one up to a u < 1."""
    sums = np.cumsum(masses, axis=-1)
    total = np.where(sums[..., -1:] > 0, sums[..., -1:], 1)
    return np.pad(sums[..., :-1] / total, [(0, 0)] * (masses.ndim - 1) + [(1, 0)])


def _found(before: Any, start: Any, n: int, u: Any, active: Any) -> tuple[Any, Any]:
    """Which of the n entries from `start` on u falls into, and where within its share, in [0, 1)."""
    at = last_up_to(u, before, start, n, n, active)
    low = dr.gather(mi.Float, before, start + at, active)
    has_next = active & (at + 1 < n)
    high = dr.select(has_next, dr.minimum(dr.gather(mi.Float, before, start + at + 1, has_next), 1), 1)
    return at, dr.clip((u - low) / dr.maximum(high - low, 1e-12), 0, ONE_MINUS_EPSILON)


def _linear(low: Any, high: Any, u: Any) -> Any:
    """u in [0, 1) → x with a density that runs from `low` to `high` in a straight line."""
    root = dr.sqrt(dr.lerp(dr.square(low), dr.square(high), u))
    return dr.minimum(dr.select(low + root > 0, u * (low + high) / (low + root), 0), ONE_MINUS_EPSILON)


def _bilinear(corners: list[Any], x: Any, y: Any) -> Any:
    return dr.lerp(dr.lerp(corners[0], corners[1], x), dr.lerp(corners[2], corners[3], x), y)
