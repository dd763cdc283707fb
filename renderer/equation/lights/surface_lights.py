"""Area lights with textures or smooth normals, sampled here by cells of their surface instead of by their plugins.

Enters: emitters. Leaves: points on those with a picture, a pattern, colours of vertices, or normals that are not those
of their triangles, with the density. Mitsuba draws a point of the texture and looks where on the surface that is: a
texture that repeats, mirrors or overlaps, a transform of its coordinates, and any shape but a rectangle make it miss a
part of the light; colours of vertices are not asked at all; and from area to solid angle it goes by the smooth normal,
which is not that of the area. Here the surface is divided into cells of known area, chosen by the radiance that each
was seen to have, mixed with a choice by area: no cell is out of reach, whatever its texture hides between the probes.
Meshes are cut into triangles, disks, spheres, cylinders and rectangles by a map of the unit square that keeps areas.
Source: pbrt-v4, sections 6.2 to 6.5 and 12.4; Heitz 2019 (points in a triangle).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights import place_tree
from renderer.equation.lights.group import Hit
from renderer.equation.mueller import intensity
from renderer.equation.primitives import FLAT_NORMAL
from renderer.equation.tables import last_up_to, registry_id, table

mi: Any = mitsuba()
Array = NDArray[np.float64]

MOST_CELLS, LEAST_CELLS = 4096, 64  # of a light, unless it has more triangles than that
CELLS_OF_ALL = 2**18
PROBES = 8  # of each cell
BY_AREA = 0.2  # share of the choice that ignores radiance
MOST_CUTS = 64  # of an edge
SHAPES = ("Rectangle", "Disk", "Sphere", "Cylinder")  # that are no meshes
RECTANGLE, DISK, SPHERE, CYLINDER = range(4)
SPECTRUM = (460.0, 530.0, 590.0, 640.0)  # wavelengths to probe, in nm


class SurfaceLights:
    """emitters: those of this kind in a scene. powers: what they emit, by registry id; NaN where no probe met light."""

    tells_radiance = False

    def __init__(self, emitters: list[Any], shapes: list[Any]) -> None:
        ids = [registry_id(emitter) for emitter in emitters]
        most = int(np.clip(CELLS_OF_ALL // len(emitters), LEAST_CELLS, MOST_CELLS))
        pieces = [_Surface.made(shape, most if is_varying(e) else 1) for e, shape in zip(emitters, shapes, strict=True)]
        self.has_meshes = any(len(piece.faces) for piece in pieces)
        self.has_round_ones = any(piece.kind is not None for piece in pieces)
        self._set_tables(pieces)
        self._alone = emitters[0] if len(emitters) == 1 else None
        self.powers = dict(zip(ids, self._choose(emitters), strict=True))
        # For each light its first cell, and how many it has.
        self._lights = table(np.stack([self._first, self._counts], axis=1).ravel(), mi.UInt32)

    @classmethod
    def among(cls, emitters: list[Any], shapes: dict[int, Any]) -> SurfaceLights | None:
        """Those among emitters, if there are any. shapes: by their emitter's registry id."""
        ours = [e for e in emitters if _is_ours(e, shapes.get(registry_id(e)))]
        return cls(ours, [shapes[registry_id(e)] for e in ours]) if ours else None

    def sample(self, ref: Any, row: Any, emitter: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """As `LightGroup.sample`."""
        first, count = (dr.gather(mi.UInt32, self._lights, 2 * row + i, active) for i in (0, 1))
        cell = first + last_up_to(u.x, self._sums, first, count, self.most_cells, active)
        low, high = dr.gather(mi.Float, self._sums, cell, active), dr.gather(mi.Float, self._ends, cell, active)
        inside = (u.x - low + 0.5 / place_tree.GRID) / (high - low)
        si = self._point(cell, mi.Point2f(dr.clip(inside, 0, 1 - 2**-24), u.y), active)
        ds = dr.zeros(mi.DirectionSample3f)
        towards = si.p - ref.p
        ds.p, ds.n, ds.uv, ds.time, ds.emitter = si.p, si.n, si.uv, ref.time, emitter
        ds.dist = dr.norm(towards)
        ds.d = towards / ds.dist
        by_area = dr.gather(mi.Float, self._densities, cell, active)
        pdf = dr.square(ds.dist) * by_area / dr.abs(dr.dot(ds.d, ds.n))
        ds.pdf = dr.select(active & (ds.dist > 0) & dr.isfinite(pdf), pdf, 0)
        si.wi = si.to_local(-ds.d)
        si.time, si.wavelengths = ref.time, ref.wavelengths
        asked = emitter if self._alone is None else self._alone
        radiance = intensity(asked.eval(si, active & (ds.pdf > 0)))
        return ds, dr.select(ds.pdf > 0, radiance / ds.pdf, 0)

    def pdf(self, ref: Any, ds: Any, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.pdf`."""
        by_area = dr.gather(mi.Float, self._densities, self._cell(si, hit.row, active), active)
        pdf = dr.square(ds.dist) * by_area / dr.abs(dr.dot(ds.d, si.n))  # ds.n is the smooth normal
        return dr.select(active & dr.isfinite(pdf), pdf, 0)

    def emission(self, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.emission`."""
        return intensity(hit.emitter.eval(si, active))

    # ------------------------------ Cells and points ------------------------------

    def _point(self, cell: Any, u: Any, active: Any) -> Any:
        """The surface at a point of a cell, u uniform on the unit square."""
        corner = dr.gather(mi.Vector4f, self._cells, cell, active)  # x, y, size, and 0 on a triangle
        piece = dr.gather(mi.UInt32, self._pieces, cell, active)
        si = dr.zeros(mi.SurfaceInteraction3f)
        if self.has_meshes:
            on_mesh = active & (corner.w == 0)
            # Both halves of the square folded upon the triangle.
            x, y = dr.select(u.y > u.x, 0.5 * u.x, u.x - 0.5 * u.y), dr.select(u.y > u.x, u.y - 0.5 * u.x, 0.5 * u.y)
            self._fill_triangle(si, piece, corner.x + corner.z * x, corner.y + corner.z * y, on_mesh)
        if self.has_round_ones:
            is_round = active & (corner.w != 0)
            self._fill_round(si, piece, corner.x + corner.z * u.x, corner.y + corner.z * u.y, is_round)
        return si

    def _fill_triangle(self, si: Any, face: Any, b1: Any, b2: Any, active: Any) -> None:
        rows = [dr.gather(mi.Vector4f, self._faces, 6 * face + i, active) for i in range(6)]
        values = [row[i] for row in rows for i in range(4)]
        p, first, second = (mi.Point3f(*values[i : i + 3]) for i in (0, 3, 6))
        normals = [mi.Normal3f(*values[i : i + 3]) for i in (15, 18, 21)]
        si.p = dr.fma(first, b1, dr.fma(second, b2, p))
        si.uv = mi.Point2f(*(values[9 + i] + b1 * values[11 + i] + b2 * values[13 + i] for i in range(2)))
        shading = dr.normalize(normals[0] * (1 - b1 - b2) + normals[1] * b1 + normals[2] * b2)
        si.sh_frame = mi.Frame3f(shading)
        across = dr.normalize(dr.cross(mi.Vector3f(first), mi.Vector3f(second)))
        si.n = mi.Normal3f(across * dr.sign(dr.dot(across, shading)))
        si.prim_index = dr.gather(mi.UInt32, self._prims, face, active)
        si.shape = dr.gather(mi.ShapePtr, self._shapes, face, active)

    def _fill_round(self, si: Any, piece: Any, x: Any, y: Any, active: Any) -> None:
        rows = [dr.gather(mi.Vector4f, self._round, 4 * piece + i, active) for i in range(4)]
        origin, *axes = (mi.Vector3f(row.x, row.y, row.z) for row in rows)
        kind, side = mi.UInt32(rows[0].w), rows[1].w
        sine, cosine = dr.sincos(dr.two_pi * x)
        radius = dr.sqrt(y)
        height = 1 - 2 * y
        ring = dr.safe_sqrt(1 - dr.square(height))
        is_disk, is_sphere, is_tube = kind == DISK, kind == SPHERE, kind == CYLINDER
        across = dr.select(is_disk, radius, dr.select(is_sphere, ring, 1))
        local = mi.Vector3f(
            dr.select(kind == RECTANGLE, 2 * x - 1, across * cosine),
            dr.select(kind == RECTANGLE, 2 * y - 1, across * sine),
            dr.select(is_sphere, height, dr.select(is_tube, y, 0)),
        )
        is_flat = (kind == RECTANGLE) | is_disk
        n = dr.select(is_flat, mi.Vector3f(0, 0, 1), mi.Vector3f(local.x, local.y, dr.select(is_tube, 0, local.z)))
        uv = mi.Point2f(
            dr.select(is_disk, radius, x),
            dr.select(is_disk, x, dr.select(is_sphere, dr.safe_acos(height) * dr.inv_pi, y)),
        )
        p = mi.Point3f(origin + axes[0] * local.x + axes[1] * local.y + axes[2] * local.z)
        # Normals of a flat shape follow its axes, those of the others are radial, and their axes are of one length.
        turned = dr.select(is_flat, dr.cross(axes[0], axes[1]), axes[0] * n.x + axes[1] * n.y + axes[2] * n.z)
        si.p, si.uv = dr.select(active, p, si.p), dr.select(active, uv, si.uv)
        si.n = dr.select(active, mi.Normal3f(dr.normalize(turned) * side), si.n)
        si.sh_frame = dr.select(active, mi.Frame3f(si.n), si.sh_frame)
        si.shape = dr.select(active, dr.gather(mi.ShapePtr, self._round_shapes, piece, active), si.shape)

    def _cell(self, si: Any, number: Any, active: Any) -> Any:
        """The cell of a point on a light."""
        row = dr.gather(mi.Vector4u, self._grids, number, active)  # first cell, first face, 0 or across, piece
        is_round = row.z > 0
        cell = row.x
        if self.has_meshes:
            on_mesh = active & ~is_round
            face = row.y + si.prim_index
            b1, b2 = self._barycentric(si.p, face, on_mesh)
            of_face = dr.gather(mi.Vector2u, self._cuts, face, on_mesh)  # first cell, and into how many along an edge
            cell = dr.select(is_round, cell, of_face.x + _triangle_at(b1, b2, of_face.y))
        if self.has_round_ones:
            x, y = self._square(si, row.w, active & is_round)
            n = mi.Float(row.z)
            at = [dr.minimum(mi.UInt32(dr.maximum(v * n, 0)), row.z - 1) for v in (x, y)]
            cell = dr.select(is_round, row.x + at[1] * row.z + at[0], cell)
        return cell

    def _barycentric(self, p: Any, face: Any, active: Any) -> tuple[Any, Any]:
        rows = [dr.gather(mi.Vector4f, self._faces, 6 * face + i, active) for i in range(3)]
        values = [row[i] for row in rows for i in range(4)]
        origin, first, second = (mi.Vector3f(*values[i : i + 3]) for i in (0, 3, 6))
        off = mi.Vector3f(p) - origin
        a, b, c = dr.squared_norm(first), dr.dot(first, second), dr.squared_norm(second)
        d, e = dr.dot(off, first), dr.dot(off, second)
        scale = dr.rcp(a * c - b * b)
        return (c * d - b * e) * scale, (a * e - b * d) * scale

    def _square(self, si: Any, piece: Any, active: Any) -> tuple[Any, Any]:
        """Where on the unit square a point of a shape that is no mesh lies."""
        rows = [dr.gather(mi.Vector4f, self._round, 4 * piece + i, active) for i in range(4)]
        origin, *axes = (mi.Vector3f(row.x, row.y, row.z) for row in rows)
        kind = mi.UInt32(rows[0].w)
        off = mi.Vector3f(si.p) - origin
        # Coordinates along the axes, which may be askew: the cross products are what is dual to them.
        volume = dr.dot(axes[0], dr.cross(axes[1], axes[2]))
        x = dr.dot(off, dr.cross(axes[1], axes[2])) / volume
        y = dr.dot(off, dr.cross(axes[2], axes[0])) / volume
        z = dr.dot(off, dr.cross(axes[0], axes[1])) / volume
        angle = dr.atan2(y, x) * dr.inv_two_pi
        angle = dr.select(angle < 0, angle + 1, angle)
        is_plate = kind == RECTANGLE
        height = dr.select(kind == DISK, x * x + y * y, dr.select(kind == SPHERE, 0.5 - 0.5 * z, z))
        return dr.select(is_plate, 0.5 * (x + 1), angle), dr.select(is_plate, 0.5 * (y + 1), height)

    # ------------------------------ Tables ------------------------------

    def _set_tables(self, pieces: list[_Surface]) -> None:
        cells, of_piece, cuts, grids = [], [], [], []
        n_cells = n_faces = n_round = 0
        for piece in pieces:
            is_round = piece.kind is not None
            grids.append((n_cells, n_faces, piece.cuts[0] if is_round else 0, n_round))
            cells.append(piece.cells)
            of_piece.append(piece.of + (n_round if is_round else n_faces))
            if not is_round:
                cuts.append(np.stack([n_cells + piece.first, piece.cuts], axis=1))
            n_cells += len(piece.cells)
            n_faces += len(piece.faces)
            n_round += is_round
        self._areas = np.concatenate([piece.areas for piece in pieces])
        self._counts = np.array([len(piece.cells) for piece in pieces])
        self._first = np.cumsum(self._counts) - self._counts
        self.most_cells = int(self._counts.max())
        self._cells = table(np.concatenate(cells).ravel(), mi.Float)
        self._pieces = table(np.concatenate(of_piece), mi.UInt32)
        self._grids = table(np.array(grids).ravel(), mi.UInt32)
        meshes = [piece for piece in pieces if piece.kind is None]
        round_ones = [piece for piece in pieces if piece.kind is not None]
        if meshes:
            self._cuts = table(np.concatenate(cuts).ravel(), mi.UInt32)
            self._faces = table(np.concatenate([piece.faces for piece in meshes]).ravel(), mi.Float)
            self._prims = table(np.concatenate([np.arange(len(piece.faces)) for piece in meshes]), mi.UInt32)
            ids = [np.full(len(piece.faces), _shape_id(piece.shape)) for piece in meshes]
            self._shapes: Any = dr.reinterpret_array(mi.ShapePtr, table(np.concatenate(ids), mi.UInt32))
        if round_ones:
            self._round = table(
                [one for piece in round_ones if piece.placed is not None for one in piece.placed], mi.Float
            )
            ids = [_shape_id(piece.shape) for piece in round_ones]
            self._round_shapes: Any = dr.reinterpret_array(mi.ShapePtr, table(ids, mi.UInt32))

    def _choose(self, emitters: list[Any]) -> list[float]:
        """Probabilities of the cells of each light: by what they were seen to give, and by their area. Returns the
        powers of the lights."""
        n = len(self._areas)
        cell = np.repeat(np.arange(n), PROBES)
        k = np.arange(PROBES) + 0.5
        u = np.stack([np.tile(k / PROBES, n), np.tile((k * 0.6180339887) % 1, n)])
        si = self._point(table(cell, mi.UInt32), mi.Point2f(*(table(x, mi.Float) for x in u)), mi.Bool(True))
        si.wi = mi.Vector3f(0, 0, 1)
        if mi.is_spectral:
            si.wavelengths = type(si.wavelengths)(*SPECTRUM)
        pointer: Any = emitters[0]
        if len(emitters) > 1:
            ids = np.repeat([registry_id(emitter) for emitter in emitters], self._counts * PROBES)
            pointer = dr.reinterpret_array(mi.EmitterPtr, table(ids, mi.UInt32))
        values = np.atleast_2d(np.array(intensity(pointer.eval(si)), np.float64)).mean(axis=0)
        given = np.broadcast_to(np.where(np.isfinite(values), np.abs(values), 0), n * PROBES).reshape(n, PROBES)
        # Between mean and root mean square: the latter is best where a cell varies inside.
        given = np.sqrt(np.square(given).mean(axis=1)) * self._areas
        sums, ends, densities = (np.zeros(n) for _ in range(3))
        powers = []
        for start, count in zip(self._first, self._counts, strict=True):
            mine = slice(start, start + count)
            area = self._areas[mine] / self._areas[mine].sum()
            total = given[mine].sum()
            chance = area if total == 0 else BY_AREA * area + (1 - BY_AREA) * given[mine] / total
            steps = place_tree.cumulative(chance[None])[0].astype(np.float64)
            sums[mine], ends[mine] = steps[:-1], steps[1:]
            densities[mine] = np.diff(steps) / np.maximum(self._areas[mine], np.finfo(np.float64).tiny)
            powers.append(float(np.pi * total) if total > 0 else float("nan"))
        self._sums, self._ends = table(sums, mi.Float), table(ends, mi.Float)
        self._densities = table(densities, mi.Float)
        return powers


def _triangle_at(b1: Any, b2: Any, cuts: Any) -> Any:
    """Number of the small triangle that a point lies in, of those that a face is cut into: row by row along b2, in each
    row in turn those that stand like the face and those upside down."""
    n = mi.Float(cuts)
    x, y = dr.clip(b1, 0, 1) * n, dr.clip(b2, 0, 1) * n
    j = dr.minimum(mi.UInt32(y), cuts - 1)
    i = dr.minimum(mi.UInt32(x), cuts - 1 - j)
    is_down = (x - mi.Float(i) + y - mi.Float(j) > 1) & (i + j + 1 < cuts)
    return (2 * cuts - j) * j + 2 * i + dr.select(is_down, mi.UInt32(1), 0)


def _triangles(cuts: int) -> Array:
    """(cuts², 3) corner and size of those, in their order; the size of those upside down is negative."""
    made = []
    for j in range(cuts):
        for i in range(cuts - j):
            made.append((i / cuts, j / cuts, 1 / cuts))
            if i + j + 1 < cuts:
                made.append(((i + 1) / cuts, (j + 1) / cuts, -1 / cuts))
    return np.array(made)


@dataclass(frozen=True, slots=True)
class _Surface:
    """One light's. cells: (n, 4) corner and size on a triangle or the unit square, and which of the two it is (0 or 1).
    of: (n,) the face of each. areas: (n,). first, cuts: of each face its first cell, and into how many an edge is cut.
    faces: (m, 24) corner, edges, texture coordinates with their edges, normals. kind, placed: of a shape that is no
    mesh its number in SHAPES, and (16,) origin and axes, with the kind and the side that its normal is on.
    """

    shape: Any
    cells: Array
    of: NDArray[np.int64]
    areas: Array
    first: NDArray[np.int64]
    cuts: NDArray[np.int64]
    faces: Array
    kind: int | None = None
    placed: Array | None = None

    @classmethod
    def made(cls, shape: Any, most: int) -> _Surface:
        """Cut into about `most` cells of equal size."""
        return cls._of_mesh(shape, most) if shape.is_mesh() else cls._of_other(shape, most)

    @classmethod
    def _of_mesh(cls, shape: Any, most: int) -> _Surface:
        faces = _faces(shape)
        areas = 0.5 * np.linalg.norm(np.cross(faces[:, 3:6], faces[:, 6:9]), axis=1)
        share = areas / max(float(areas.sum()), np.finfo(np.float64).tiny)
        cuts = np.clip(np.sqrt(most * share).astype(np.int64), 1, MOST_CUTS)
        counts = cuts**2
        first = np.cumsum(counts) - counts
        of = np.repeat(np.arange(len(faces)), counts)
        cells = np.zeros((len(of), 4))
        for n in np.unique(cuts):
            cells[cuts[of] == n, :3] = np.tile(_triangles(int(n)), (int((cuts == n).sum()), 1))
        return cls(shape, cells, of, (areas / counts)[of], first, cuts, faces)

    @classmethod
    def _of_other(cls, shape: Any, most: int) -> _Surface:
        kind = SHAPES.index(shape.class_name())
        matrix = np.array(mi.traverse(shape)["to_world"].matrix, np.float64).reshape(4, 4)
        origin, axes = matrix[:3, 3], matrix[:3, :3].T.copy()
        if kind in (RECTANGLE, DISK):
            axes[2] = np.cross(axes[0], axes[1])
            axes[2] *= np.sqrt(np.linalg.norm(axes[2])) / np.linalg.norm(axes[2])
        outwards = axes[2] if kind in (RECTANGLE, DISK) else axes[0]
        n = normal_at(shape, origin + (0 if kind in (RECTANGLE, DISK) else axes[0]))
        placed = np.zeros((4, 4))
        placed[0, :3], placed[1:, :3] = origin, axes
        placed[0, 3], placed[1, 3] = kind, np.sign(n @ outwards)
        along = min(int(np.sqrt(most)), MOST_CUTS)
        y, x = np.divmod(np.arange(along**2), along)
        cells = np.stack([x / along, y / along, np.full(along**2, 1 / along), np.ones(along**2)], axis=1)
        area = float(np.array(shape.surface_area()).ravel()[0])
        of = np.zeros(along**2, np.int64)
        return cls(
            shape, cells, of, np.full(along**2, area / along**2), of[:0], np.array([along]), np.zeros((0, 24)), kind,
            placed.ravel(),
        )  # fmt: skip


def normal_at(shape: Any, p: Array) -> Array:
    """Of a shape that is no mesh, as a ray meets it. Mitsuba's own samples of a turned sphere have another."""
    pi = dr.zeros(mi.PreliminaryIntersection3f)
    pi.shape, pi.t, pi.valid = mi.ShapePtr(shape), mi.Float(1), mi.Bool(True)
    ray = mi.Ray3f(mi.Point3f(*map(float, p)) - mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, 1))
    si = pi.compute_surface_interaction(ray, mi.RayFlags.All)
    return np.array(si.sh_frame.n, np.float64).ravel()


def _faces(mesh: Any) -> Array:
    """(m, 24) of a mesh's triangles, see `_Surface`: what Mitsuba says that a ray meets at their corners."""
    n = int(mesh.face_count())
    pi = dr.zeros(mi.PreliminaryIntersection3f, 3 * n)
    pi.shape, pi.t, pi.valid = mi.ShapePtr(mesh), dr.full(mi.Float, 1, 3 * n), dr.full(mi.Bool, True, 3 * n)
    pi.prim_index = table(np.repeat(np.arange(n), 3), mi.UInt32)
    pi.prim_uv = mi.Point2f(table(np.tile([0, 1, 0], n), mi.Float), table(np.tile([0, 0, 1], n), mi.Float))
    si = pi.compute_surface_interaction(mi.Ray3f(mi.Point3f(0), mi.Vector3f(0, 0, 1)), mi.RayFlags.All)
    p, uv, normal = (np.array(v, np.float64).reshape(-1, n, 3).transpose(1, 2, 0) for v in (si.p, si.uv, si.sh_frame.n))
    return np.concatenate(
        [p[:, 0], p[:, 1] - p[:, 0], p[:, 2] - p[:, 0], uv[:, 0], uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]]
        + [normal[:, i] for i in range(3)],
        axis=1,
    )


def _shape_id(shape: Any) -> int:
    number: Any = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
    return int(number[0])


# ------------------------------ Which lights these are ------------------------------


def is_varying(emitter: Any) -> bool:
    """Whether an area light's radiance differs from place to place. Colours of vertices do not say so themselves."""
    if emitter.class_name() != "AreaLight":
        return False
    return mi.has_flag(emitter.flags(), mi.EmitterFlags.SpatiallyVarying) or _texture(emitter) == "MeshAttribute"


def is_smooth(shape: Any) -> bool:
    """Whether a mesh has normals that are not those of its triangles."""
    if not shape.is_mesh() or not shape.has_vertex_normals():
        return False
    faces = np.array(shape.faces_buffer(), np.int64).reshape(-1, 3)
    corners, normals = (
        np.array(values, np.float64).reshape(-1, 3)[faces]
        for values in (shape.vertex_positions_buffer(), shape.vertex_normals_buffer())
    )
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1, keepdims=True) * np.linalg.norm(normals, axis=2)
    return bool((np.abs(np.einsum("fvi,fi->fv", normals, across)) < (1 - FLAT_NORMAL) * lengths).any())


def _is_ours(emitter: Any, shape: Any) -> bool:
    if shape is None or emitter.class_name() != "AreaLight":
        return False
    return not _is_right(emitter, shape) if is_varying(emitter) else is_smooth(shape)


def _is_right(emitter: Any, shape: Any) -> bool:
    """Whether Mitsuba's own sampling finds all of a varying light: on a rectangle whose texture covers it once."""
    if shape.class_name() != "Rectangle":
        return False
    if not _texture(emitter).startswith("BitmapTexture"):
        return True
    known = mi.traverse(emitter)
    to_uv, values = np.array(known["radiance.to_uv"].matrix, np.float64), np.array(known["radiance.data"])
    is_light = bool(np.isfinite(values).all() and (values >= 0).all() and (values > 0).any())
    return is_light and np.allclose(to_uv.reshape(3, 3), np.eye(3))


def _texture(emitter: Any) -> str:
    """Class of what says an area light's radiance."""
    found: list[str] = []

    class Names(mi.TraversalCallback):
        def put(self, name: str, value: Any, _flags: Any, _cpptype: Any = None) -> None:
            if name == "radiance" and isinstance(value, mi.Object):
                found.append(value.class_name())

    emitter.traverse(Names())
    return found[0] if found else ""
