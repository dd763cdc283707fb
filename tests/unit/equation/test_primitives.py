"""Facts about reading primitives from shapes: what is one plate, what shares a key, what is too much."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from renderer.backend import mitsuba
from renderer.equation.primitives import Primitives, primitives_of

mi = mitsuba()
T = mi.ScalarTransform4f


def found(**shapes: dict[str, Any]) -> Primitives | None:
    return primitives_of(mi.load_dict({"type": "scene", **shapes}))


def of(**shapes: dict[str, Any]) -> Primitives:
    primitives = found(**shapes)
    assert primitives is not None
    return primitives


def test_a_rectangle_is_one_plate() -> None:
    (plate,) = of(a={"type": "rectangle", "to_world": T().translate([1, 2, 3]).scale([2, 1, 1])}).plates
    assert plate.normal @ [1, 2, 3] == pytest.approx(plate.offset)
    for corner, at in (((-1, 1, 3), 1), ((3, 3, 3), 1), ((1, 2, 3), 0)):
        assert np.abs(plate.axes @ corner + plate.origin).max() == pytest.approx(at)


def test_a_cube_is_six_plates_along_the_axes_at_half_the_cost() -> None:
    cube = of(a={"type": "cube"})
    assert [np.count_nonzero(plate.normal) for plate in cube.plates] == [1] * 6
    assert len({plate.key for plate in cube.plates}) == 6
    assert cube.cost == 3


def test_plates_in_one_plane_share_a_key_whichever_side_they_show() -> None:
    up, down = T().translate([3, 0, 0]), T().translate([-3, 0, 0]).rotate([1, 0, 0], 180)
    above = T().translate([0, 0, 1e-4])
    keys = [
        plate.key
        for plate in of(**{n: {"type": "rectangle", "to_world": t} for n, t in (("a", up), ("b", down))}).plates
    ]
    assert keys[0] == keys[1]
    apart = of(**{n: {"type": "rectangle", "to_world": t} for n, t in (("a", up), ("b", above))}).plates
    assert apart[0].key != apart[1].key


def test_the_order_follows_from_the_places_alone() -> None:
    shapes = {f"s{i}": {"type": "sphere", "center": [i, -i, 0]} for i in range(5)}
    forward, backward = of(**shapes), of(**dict(reversed(shapes.items())))
    assert [tuple(ball.centre) for ball in forward.balls] == [tuple(ball.centre) for ball in backward.balls]


def test_spheres_and_cylinders_keep_their_measures() -> None:
    primitives = of(
        ball={"type": "sphere", "to_world": T().translate([0, 1, 0]).scale(2), "radius": 3},
        tube={"type": "cylinder", "p0": [0, 0, 1], "p1": [0, 4, 1], "radius": 0.5},
    )
    assert primitives.balls[0].radius == pytest.approx(6)
    assert (primitives.tubes[0].length, primitives.tubes[0].radius) == (pytest.approx(4), pytest.approx(0.5))
    assert primitives.tubes[0].axis == pytest.approx([0, 1, 0], abs=1e-6)


def test_other_shapes_and_too_many_are_for_the_tree() -> None:
    assert found(a={"type": "disk"}) is None
    assert found(**{f"s{i}": {"type": "sphere", "center": [i, 0, 0]} for i in range(300)}) is None


def test_normals_at_vertices_are_noticed(tmp_path: Any) -> None:
    file = tmp_path / "bent.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0.6 0 0.8\nf 1//1 2//2 3//1\n")
    assert of(a={"type": "obj", "filename": str(file)}).has_normals
    assert not of(a={"type": "rectangle"}).has_normals
