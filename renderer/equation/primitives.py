"""The primitives of a small scene: plates and triangles, spheres and cylinders, read from Mitsuba's shapes. NumPy only.

Enters: a loaded scene. Leaves: `Primitives`, or None where the scene has too many or other shapes. Two triangles that
make a parallelogram are one plate, with half the work; plates in one plane share a key, by which a ray that starts on
one passes over all of them (`rays.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_TRIANGLES = 1024  # worth looking at
LEAST_COST = 0.5  # of a plate along the axes, in plates that lie askew
MOST_COST = 120.0  # in plates, from which on a tree is faster
FLAT_NORMAL = 1e-6  # 1 − cosine up to which a vertex normal is that of its face
SAME_PLACE = 1e-6  # relative to the size of the scene


@dataclass(frozen=True, slots=True)
class Plate:
    """The points p with n·p = offset and u, v = (axes·p + origin) within −1 … 1; of a triangle 0 … 1, u + v ≤ 1.

    shape: its number among the scene's. faces: the triangles it consists of. barycentric: (faces, 2, 3) Mitsuba's
    prim_uv on each as constant, and factors of u and v; the second face is where v > u.
    """

    normal: Array
    offset: float
    axes: Array
    origin: Array
    is_triangle: bool
    key: int
    shape: int
    faces: tuple[int, ...]
    barycentric: Array

    @property
    def cost(self) -> float:
        """Of a test, relative to a plate that lies askew."""
        return LEAST_COST if np.count_nonzero(self.normal) == 1 else 1.0


@dataclass(frozen=True, slots=True)
class Ball:
    """A sphere."""

    centre: Array
    radius: float
    key: int
    shape: int
    cost = 1.2


@dataclass(frozen=True, slots=True)
class Tube:
    """A cylinder without its ends: points at `radius` from the axis, 0 … length along it from `start`."""

    start: Array
    axis: Array
    length: float
    radius: float
    key: int
    shape: int
    cost = 2.0


@dataclass(frozen=True, slots=True)
class Primitives:
    """Numbered in this order: plates, balls, tubes. has_normals: whether plates have normals of their own at vertices.
    size: of the scene, in which rounding is counted."""

    plates: tuple[Plate, ...]
    balls: tuple[Ball, ...]
    tubes: tuple[Tube, ...]
    has_normals: bool
    size: float

    @property
    def all(self) -> tuple[Plate | Ball | Tube, ...]:
        """In the order of their numbers."""
        return (*self.plates, *self.balls, *self.tubes)

    @property
    def cost(self) -> float:
        """Of trying all of them, in plates."""
        return sum(each.cost for each in self.all)


def listed(scene: Any) -> Primitives:
    """The primitives of a scene that `primitives_of` has some for."""
    found = primitives_of(scene)
    assert found is not None
    return found


def primitives_of(scene: Any) -> Primitives | None:
    """The primitives of a Mitsuba scene; None where there are too many, or shapes of other kinds."""
    from renderer.backend import mitsuba

    mi = mitsuba()
    shapes = list(scene.shapes())
    kinds = [str(shape.class_name()) for shape in shapes]
    if any(
        not shape.is_mesh() and kind not in ("Sphere", "Cylinder") for shape, kind in zip(shapes, kinds, strict=True)
    ):
        return None
    if sum(int(shape.face_count()) for shape in shapes if shape.is_mesh()) > MOST_TRIANGLES:
        return None
    # Not the scene's own bounds: merged meshes have none in Mitsuba 3.9.1.
    reach = [np.abs(np.array(shape.vertex_positions_buffer())).max(initial=0.0) for shape in shapes if shape.is_mesh()]
    reach += [np.abs(np.array([box.min, box.max])).max() for box in (s.bbox() for s in shapes if not s.is_mesh())]
    size = max(float(np.max(reach, initial=0.0)), 1e-30)
    found_plates: list[tuple[int, tuple[int, ...], Array]] = []
    has_normals = False
    for number, shape in enumerate(shapes):
        if not shape.is_mesh():
            continue
        corners, normals = _faces(shape)
        if normals is not None:
            cosines = np.einsum("fvi,fi->fv", normals, _face_normals(corners))
            has_normals |= bool(np.any(np.abs(cosines) < 1 - FLAT_NORMAL))
        for faces in _parts(corners, size * SAME_PLACE):
            found_plates.append((number, faces, corners))
    if len(found_plates) * LEAST_COST > MOST_COST:
        return None
    # Shapes are loaded side by side and come in any order: what becomes code must not.
    found_plates.sort(key=lambda plate: tuple(plate[2][list(plate[1])].ravel()))
    planes: list[tuple[Array, float]] = []
    plates = [_plate(*plate, planes, size) for plate in found_plates]
    balls, tubes = [], []
    round_ones = [i for i, shape in enumerate(shapes) if not shape.is_mesh()]
    for number in sorted(round_ones, key=lambda i: tuple(_to_world(mi, shapes[i]).ravel())):
        shape, kind = shapes[number], kinds[number]
        key = len(planes) + len(balls) + len(tubes)
        if kind == "Sphere":
            matrix = _to_world(mi, shape)
            balls.append(Ball(matrix[:3, 3], float(np.linalg.norm(matrix[:3, 0])), key, number))
        elif kind == "Cylinder":
            matrix = _to_world(mi, shape)
            length = float(np.linalg.norm(matrix[:3, 2]))
            radius = float(np.linalg.norm(matrix[:3, 0]))
            tubes.append(Tube(matrix[:3, 3], matrix[:3, 2] / length, length, radius, key, number))
    found = Primitives(tuple(plates), tuple(balls), tuple(tubes), has_normals, size)
    return found if found.all and found.cost <= MOST_COST else None


def sphere_of(shape: Any) -> tuple[Array, float] | None:
    """Centre and radius of a sphere; None for other shapes."""
    from renderer.backend import mitsuba

    if shape.class_name() != "Sphere":
        return None
    matrix = _to_world(mitsuba(), shape)
    return matrix[:3, 3], float(np.linalg.norm(matrix[:3, 0]))


def whole_plate_of(shape: Any) -> tuple[Array, Array, Array] | None:
    """Centre and half edges of a mesh that is one parallelogram; None for other shapes."""
    if not shape.is_mesh() or shape.face_count() != 2:
        return None
    corners, _ = _faces(shape)
    found = _opposite(corners[0], corners[1], SAME_PLACE * float(np.abs(corners).max(initial=1e-30)))
    if found is None:
        return None
    tip, far, origin = (corners[0, found[0] - k] for k in (0, 2, 1))
    return (origin + far) / 2, (tip - origin) / 2, (far - tip) / 2


def _to_world(mi: Any, shape: Any) -> Array:
    return np.array(mi.traverse(shape)["to_world"].matrix, dtype=np.float64).reshape(4, 4)


def _faces(mesh: Any) -> tuple[Array, Array | None]:
    """(n, 3, 3) corners of each triangle, and the normals at them where the mesh has any."""
    faces = np.array(mesh.faces_buffer(), np.int64).reshape(-1, 3)
    corners = np.array(mesh.vertex_positions_buffer(), np.float64).reshape(-1, 3)[faces]
    normals = np.array(mesh.vertex_normals_buffer(), np.float64).reshape(-1, 3)
    return corners, normals[faces] if len(normals) else None


def _face_normals(corners: Array) -> Array:
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return crossed / np.maximum(np.linalg.norm(crossed, axis=1, keepdims=True), 1e-300)


def _parts(corners: Array, tolerance: float) -> list[tuple[int, ...]]:
    """The triangles of a mesh, those together that make a parallelogram; none that is a line or a point."""
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    longest = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2).max(axis=1)
    places = [[tuple(corner) for corner in face] for face in np.rint(corners / (10 * tolerance)).astype(np.int64)]
    left = {i: None for i in range(len(corners)) if np.linalg.norm(crossed[i]) > tolerance * longest[i]}
    along: dict[tuple[Any, Any], list[int]] = {}  # faces by edge
    for face in left:
        for k in range(3):
            along.setdefault((places[face][k - 1], places[face][k]), []).append(face)
    parts: list[tuple[int, ...]] = []
    while left:
        face = next(iter(left))
        del left[face]
        beside = [other for k in range(3) for other in along.get((places[face][k], places[face][k - 1]), ())]
        beside = [other for other in beside if other in left]
        partner = next((other for other in beside if _opposite(corners[face], corners[other], tolerance)), None)
        if partner is not None:
            del left[partner]
        parts.append((face,) if partner is None else (face, partner))
    return parts


def _opposite(a: Array, b: Array, tolerance: float) -> tuple[int, int] | None:
    """The corners of two triangles that face each other across a shared edge, if both make a parallelogram."""
    for i in range(3):
        for j in range(3):
            shared_a, shared_b = (a[i - 2], a[i - 1]), (b[j - 1], b[j - 2])  # run through in opposite directions
            if all(np.abs(p - q).max() <= tolerance for p, q in zip(shared_a, shared_b, strict=True)):
                return (i, j) if np.abs(a[i] + b[j] - a[i - 2] - a[i - 1]).max() <= tolerance else None
    return None


def _plate(
    number: int, faces: tuple[int, ...], corners: Array, planes: list[tuple[Array, float]], size: float
) -> Plate:
    a = corners[faces[0]]
    if len(faces) == 1:
        origin, first, second = a[0], a[1] - a[0], a[2] - a[0]
        barycentric = np.array([[[0.0, 1, 0], [0, 0, 1]]])
    else:
        found = _opposite(a, corners[faces[1]], size * SAME_PLACE)
        assert found is not None
        i, j = found
        # Corners in the order 00, 10, 11, 01, the diagonal from 00 to 11; 10 is that of the first face alone.
        origin, tip, far = a[i - 1], a[i], a[i - 2]
        first, second = tip - origin, far - tip
        # Weights of a face's own three corners as constant, factor of u, factor of v, in the order of the face.
        weights = np.zeros((2, 3, 3))
        weights[0, i], weights[0, i - 2], weights[0, i - 1] = (0, 1, -1), (0, 0, 1), (1, -1, 0)
        weights[1, j], weights[1, j - 1], weights[1, j - 2] = (0, -1, 1), (0, 1, 0), (1, 0, -1)
        barycentric = weights[:, 1:]
    normal = np.cross(first, second)
    normal /= np.linalg.norm(normal)
    normal = _snapped(normal)
    offset = float(np.mean(corners[list(faces)].reshape(-1, 3) @ normal))
    # Rows that give u and v of a point in the plane: dual to the edges.
    axes = np.linalg.inv(np.array([first, second, normal]).T)[:2]
    is_triangle = len(faces) == 1
    start = -axes @ origin
    if not is_triangle:  # −1 … 1 takes one comparison instead of two
        axes, start = 2 * axes, 2 * start - 1
        barycentric = np.stack(
            [
                barycentric[..., 0] + 0.5 * (barycentric[..., 1] + barycentric[..., 2]),
                0.5 * barycentric[..., 1],
                0.5 * barycentric[..., 2],
            ],
            axis=-1,
        )
    largest = np.abs(axes).max(axis=1, keepdims=True)
    axes = np.where(np.abs(axes) < 1e-7 * largest, 0.0, axes)
    key = _plane(planes, normal, offset, size)
    return Plate(normal, offset, axes, start, is_triangle, key, number, faces, barycentric)


def _snapped(normal: Array) -> Array:
    """Exactly along an axis where it is so but for rounding."""
    axis = int(np.argmax(np.abs(normal)))
    if np.abs(np.delete(normal, axis)).max() > 1e-7:
        return normal
    return np.where(np.arange(3) == axis, np.sign(normal[axis]), 0.0)


def _plane(planes: list[tuple[Array, float]], normal: Array, offset: float, size: float) -> int:
    """The key of a plane; a new one where there was none like it."""
    for key, (other, distance) in enumerate(planes):
        side = np.sign(normal @ other)
        if np.abs(normal - side * other).max() < 1e-6 and abs(offset - side * distance) < size * SAME_PLACE:
            return key
    planes.append((normal, offset))
    return len(planes) - 1
