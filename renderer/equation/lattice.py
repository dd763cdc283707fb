"""What is known of extinction in grid media on the cells of a coarse lattice, and how a ray walks through the cells.

Enters: media as Mitsuba has loaded them. Leaves: tables that kernels read (the greatest extinction of each cell; a
control near its mean, and how far from that it gets), and walks: from a place on a ray, the next one where the optical
depth of those bounds reaches a number that was drawn. Where a grid is empty the greatest is 0, and a walk crosses it
without asking the grid.

A voxel counts for all cells that interpolation may carry it to. The grid's transform is known by what Mitsuba prints,
to six digits: as much is added to the reach of each voxel. Where that is more than a voxel, and for colours in spectral
rendering, whose voxels are no extinctions, a medium is one cell, whose greatest extinction is what the medium says.

Sources: Amanatides & Woo 1987 (cells along a ray); Szirmay-Kalos et al. 2011, Novák et al. 2014 (local bounds).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import drjit
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.tables import table

dr: Any = drjit
mi: Any = mitsuba()

VOXELS = 4  # along an edge of a cell, at least
MOST_CELLS = 64  # along an edge of the lattice
LEAST_DEPTH = 0.25  # of the thickest cell: thinner ones cost more to cross than they save
THIN = 1.0  # difference in optical depth across a cell up to which its mean is the best control
PRINTED = 1e-5  # relative error of the numbers that Mitsuba prints
ROUNDING = 0.02  # voxels, by which rays in float32 may miss the cell that they are in
FLOATS = 12  # of an affine map


@dataclass(frozen=True, slots=True)
class Lattice:
    """most: (z, y, x) greatest extinction in each cell, over all channels. control: the mean one in thin cells, nearer
    to the least one in thick ones. spread: the furthest from the control. to_cells: (3, 4) affine map from the world to
    places in units of cells."""

    most: NDArray[np.float32]
    control: NDArray[np.float32]
    spread: NDArray[np.float32]
    to_cells: NDArray[np.float64]


class Line:
    """A ray among cells: o, d in their units. n: cells along each axis, first: the place of cell 0 in the tables.
    Loops read it and do not change it."""

    def __init__(self, o: Any, d: Any, n: Any, first: Any, tables: tuple[Any, Any]) -> None:
        self.o, self.d, self.n, self.first = o, d, n, first
        self._most, self._controls = tables
        self.inverse = dr.select(d != 0, 1 / d, 0)
        self.ahead = mi.Vector3f(dr.select(d > 0, 1, 0))  # whether the next face along an axis is the cell's far one
        self.side = mi.Vector3i(dr.select(d > 0, 1, -1))

    def begin(self, t: Any) -> Any:
        """The cell at a distance t."""
        return dr.clip(mi.Vector3i(dr.floor(dr.fma(self.d, t, self.o))), 0, self.n - 1)

    def _place(self, cell: Any) -> Any:
        """Where a cell is in the tables; beyond the lattice, the last one before its border."""
        at = dr.clip(cell, 0, self.n - 1)
        return self.first + mi.UInt32((at.z * self.n.y + at.y) * self.n.x + at.x)

    @dr.syntax
    def on(self, t: Any, cell: Any, depth: Any, end: Any, is_residual: bool, active: Any) -> tuple[Any, ...]:
        """From t on to where the optical depth of the greatest extinction (of the spread, if residual) is `depth`, or
        to `end`. Returns t and the cell there, its rate, its control, and the optical depth of the controls on the way
        (0 for both if not residual)."""
        rate, control, even = mi.Float(1), mi.Float(0), mi.Float(0)
        going = mi.Bool(active)
        while dr.hint(going, label="cells"):
            if dr.hint(is_residual, mode="scalar"):
                pair = dr.gather(mi.Vector2f, self._controls, self._place(cell), going)
                control, rate = mi.Float(pair.x), mi.Float(pair.y)
            else:
                rate = dr.gather(mi.Float, self._most, self._place(cell), going)
            faces = dr.select(self.d != 0, (mi.Vector3f(cell) + self.ahead - self.o) * self.inverse, dr.inf)
            face = dr.maximum(dr.min(faces), t)
            leaves = dr.minimum(face, end)
            room = rate * (leaves - t)
            is_here = depth < room
            reached = dr.select(is_here, t + depth / rate, leaves)
            if dr.hint(is_residual, mode="scalar"):
                even += control * (reached - t)
            t = reached
            depth -= room
            cell = dr.select(~is_here & (faces <= face), cell + self.side, cell)
            going &= ~is_here & (leaves < end)
        return t, cell, rate, control, even


class Evenly:
    """As `Line`, where nothing is known but one greatest extinction."""

    def __init__(self, rate: Any) -> None:
        self.rate = dr.select(rate > 0, rate, 0)

    def begin(self, t: Any) -> Any:
        return mi.Vector3i(0)

    def on(self, t: Any, cell: Any, depth: Any, end: Any, is_residual: bool, active: Any) -> tuple[Any, ...]:
        """As `Line.on`."""
        return dr.select(self.rate > 0, t + depth / self.rate, end), cell, self.rate, mi.Float(0), mi.Float(0)


class Lattices:
    """Of all grid media of a scene. media: by the key that kernels know them by."""

    def __init__(self, media: dict[int, Any]) -> None:
        found = {key: lattice_of(medium) for key, medium in media.items() if not medium.is_homogeneous()}
        self.by_key = found
        sizes = [one.most.size for one in found.values()]
        firsts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.uint32)
        records = np.zeros(max(found, default=0) + 1, np.uint32)
        records[list(found)] = np.arange(len(found))
        counts = [[*one.most.shape[::-1], first] for one, first in zip(found.values(), firsts, strict=True)]
        controls = [np.stack([one.control, one.spread], -1).ravel() for one in found.values()]
        self.is_one = len(found) == 1
        self._record = table(records, mi.UInt32)
        self._map = table(np.concatenate([one.to_cells.ravel() for one in found.values()]), mi.Float)
        self._counts = table(np.concatenate(counts), mi.UInt32)
        self._most = table(np.concatenate([one.most.ravel() for one in found.values()]), mi.Float)
        self._controls = table(np.concatenate(controls), mi.Float)

    def line(self, key: Any, ray: Any, active: Any) -> Line:
        """A ray in the medium of this key."""
        record = mi.UInt32(0) if self.is_one else dr.gather(mi.UInt32, self._record, key, active)
        rows = [
            [dr.gather(mi.Float, self._map, FLOATS * record + 4 * i + j, active) for j in range(4)] for i in range(3)
        ]
        n = mi.Vector3i(*(mi.Int(dr.gather(mi.UInt32, self._counts, 4 * record + i, active)) for i in range(3)))
        first = dr.gather(mi.UInt32, self._counts, 4 * record + 3, active)
        o = mi.Point3f(*(dr.fma(a, ray.o.x, dr.fma(b, ray.o.y, dr.fma(c, ray.o.z, d))) for a, b, c, d in rows))
        d = mi.Vector3f(*(a * ray.d.x + b * ray.d.y + c * ray.d.z for a, b, c, _ in rows))
        return Line(o, d, n, first, (self._most, self._controls))


def lattice_of(medium: Any) -> Lattice:
    """The bounds of a medium that Mitsuba has loaded."""
    rate = float(np.max(np.array(dr.max(medium.get_majorant(dr.zeros(mi.MediumInteraction3f), True)))))
    one = np.full((1, 1, 1), rate, np.float32)
    whole = Lattice(one, 0 * one, one, np.zeros((3, 4)))
    properties: dict[str, Any] = mi.traverse(medium).properties
    if "sigma_t.data" not in properties or not rate > 0:
        return whole
    parts = properties["sigma_t.data"]
    volume = next(one for one in parts if isinstance(one, mi.Volume))
    data = np.array(mi.traverse(volume)["data"])
    # Four channels are the coefficients of spectra, not their values.
    if data.ndim != 4 or data.shape[-1] not in (1, 3) or not volume.max() > 0:
        return whole
    printed = re.search(r"to_local = Transform\[\s*matrix=\[(.*?)\],\s*inverse_transpose", str(volume), re.DOTALL)
    if printed is None:
        return whole
    numbers = [float(one) for one in re.findall(r"[-+.\deE]+|inf|nan", printed[1])]
    if len(numbers) != 16 or not np.isfinite(numbers).all():
        return whole
    return _cells(data, np.array(numbers).reshape(4, 4)[:3], volume.bbox(), rate / float(volume.max())) or whole


def _cells(data: NDArray, to_local: NDArray, bbox: Any, scale: float) -> Lattice | None:
    """data: (z, y, x, channels), which times `scale` are extinctions. to_local: (3, 4), to the grid's unit cube.
    None where that is not known well enough."""
    low, high = np.array(bbox.min, np.float64).ravel(), np.array(bbox.max, np.float64).ravel()
    corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
    size = np.array(data.shape[2::-1], np.float64)  # voxels along x, y, z
    error = PRINTED * (np.abs(corners) @ np.abs(to_local[:, :3]).T + np.abs(to_local[:, 3])).max(0) * size
    reach = error + ROUNDING
    if not (np.isfinite(reach).all() and reach.max() <= 1):
        return None
    # Of a grid that is turned, the box around it is more than its cube: interpolation goes on there.
    local = corners @ to_local[:, :3].T + to_local[:, 3]
    depth = scale * float(data.max()) * np.linalg.norm(high - low)  # of the whole, at most
    n = np.clip(np.minimum(size / VOXELS, max(depth / LEAST_DEPTH, 1)), 1, MOST_CELLS).astype(int)
    first = np.floor(np.minimum(local.min(0), 0) * n + 1e-3).astype(int)
    last = np.ceil(np.maximum(local.max(0), 1) * n - 1e-3).astype(int)
    if (last - first > 4 * MOST_CELLS).any():
        return None
    upper, lower, middle = data.max(-1), data.min(-1), data.mean(-1)
    for axis, k in ((2, 0), (1, 1), (0, 2)):
        touched = [_voxels(c, int(n[k]), int(size[k]), float(reach[k])) for c in range(first[k], last[k])]
        upper = np.stack([upper.take(one, axis).max(axis) for one in touched], axis)
        lower = np.stack([lower.take(one, axis).min(axis) for one in touched], axis)
        middle = np.stack([middle.take(one, axis).mean(axis) for one in touched], axis)
    to_cells = to_local * n[:, None]
    to_cells[:, 3] -= first
    wider = 1 + 1e-6  # than rounding
    upper, lower, middle = (scale * one.astype(np.float64) for one in (upper, lower, middle))
    # Weights of up to 2 about the mean serve thin cells; in thick ones their products have no bound.
    across = (upper - lower) / np.linalg.norm(to_cells[:, :3], axis=1).min()
    control = lower + np.minimum(THIN / np.maximum(across, 1e-30), 1) * (middle - lower)
    spread = np.maximum(upper * wider - control, control - lower / wider)
    most, control, spread = (one.astype(np.float32) for one in (upper * wider, control, spread))
    return Lattice(most, control, spread, to_cells)


def _voxels(cell: int, n: int, size: int, reach: float) -> NDArray[np.int64]:
    """Along one axis: the voxels that a value in a cell, one of n along the unit cube, may be interpolated from.
    Beyond the border, those that any way of going on there leads to: the last ones, repeated or mirrored ones."""
    low, high = (int(np.floor((cell + k) / n * size - 0.5 + sign * reach)) for k, sign in ((0, -1), (1, 1)))
    touched = np.arange(low, high + 2)
    if touched[0] >= 0 and touched[-1] < size:
        return touched
    repeated = touched % size
    return np.unique(np.concatenate([np.clip(touched, 0, size - 1), repeated, size - 1 - repeated]))
