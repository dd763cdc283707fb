"""Bounds of grid media on a lattice: they hold everywhere, and empty space is crossed without asking the grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import renderer
from renderer.backend import mitsuba, using

KEY = 1
POINTS = 20_000


def grid_medium(data: np.ndarray, **volume: Any) -> dict[str, Any]:
    made = {"type": "gridvolume", "grid": mitsuba().VolumeGrid(data.astype(np.float32)), **volume}
    return {"type": "heterogeneous", "sigma_t": made, "albedo": 0.5, "scale": 3.0}


def sparse(shape: tuple[int, ...]) -> np.ndarray:
    """Mostly nothing, and a few dense voxels, also at the border."""
    rng = np.random.default_rng(4)
    data = rng.random(shape) * (rng.random(shape) < 0.001)
    data[0, 0, 0] = data[-1, -1, 0] = 1
    return data


GRIDS: dict[str, Any] = {
    "plain": lambda t: {"data": sparse((20, 33, 40))},
    "moved": lambda t: {"data": sparse((40, 8, 16)), "to_world": t().translate([30, -2, 8]).scale([3, 1, 7])},
    "turned": lambda t: {"data": sparse((24, 24, 24)), "to_world": t().rotate([1, 2, 3], 40).scale(2)},
    "turned and repeated": lambda t: {
        "data": sparse((24, 30, 24)),
        "to_world": t().rotate([1, 2, 3], 40),
        "wrap_mode": "repeat",
    },
    "mirrored": lambda t: {"data": sparse((16, 16, 21)), "to_world": t().rotate([0, 1, 0], 10), "wrap_mode": "mirror"},
    "coloured": lambda t: {"data": np.repeat(sparse((16, 16, 16))[..., None], 3, -1) * [1.0, 0.2, 0.6]},
    "nearest": lambda t: {"data": sparse((16, 17, 18)), "filter_type": "nearest"},
    "one voxel": lambda t: {"data": np.ones((1, 1, 1))},
    "nothing": lambda t: {"data": np.zeros((9, 9, 9))},
}


@pytest.mark.parametrize("name", GRIDS)
def test_no_extinction_is_beyond_the_bounds_of_its_cell(name: str) -> None:
    with using("llvm_ad_rgb"):
        mi = mitsuba()
        from renderer.equation.lattice import lattice_of

        medium: Any = mi.load_dict(grid_medium(**GRIDS[name](mi.ScalarTransform4f)))
        lattice = lattice_of(medium)
        box = mi.traverse(medium).properties["sigma_t.data"][2].bbox()
        low, high = np.array(box.min).ravel(), np.array(box.max).ravel()
        places = low + (high - low) * np.random.default_rng(5).random((POINTS, 3))
        at = mi.MediumInteraction3f()
        at.p = mi.Point3f(places.T.astype(np.float32))
        sigma_t = np.array(medium.get_scattering_coefficients(at, True)[2]).reshape(3, -1)
    cells = places @ lattice.to_cells[:, :3].T + lattice.to_cells[:, 3]
    n = np.array(lattice.most.shape[::-1])
    assert (cells > -1e-3).all()
    assert (cells < n + 1e-3).all()
    x, y, z = np.clip(np.floor(cells), 0, n - 1).astype(int).T
    assert (sigma_t.max(0) <= lattice.most[z, y, x] * (1 + 1e-5)).all()
    off = np.abs(sigma_t - lattice.control[z, y, x])
    assert (off.max(0) <= lattice.spread[z, y, x] + 1e-5 * lattice.most[z, y, x]).all()
    if name not in ("one voxel", "nothing"):
        assert (lattice.most == 0).any()


def test_a_grid_far_from_the_origin_is_one_cell() -> None:
    """Six printed digits do not tell where its voxels are."""
    with using("llvm_ad_rgb"):
        mi = mitsuba()
        from renderer.equation.lattice import lattice_of

        to_world = mi.ScalarTransform4f().translate([1e5, 0, 0])
        lattice = lattice_of(mi.load_dict(grid_medium(sparse((8, 8, 128)), to_world=to_world)))
    assert lattice.most.shape == (1, 1, 1)
    assert lattice.most.item() == pytest.approx(3.0)


def test_thin_air_around_a_dense_voxel_costs_nothing() -> None:
    data = np.zeros((32, 32, 32))
    data[3, 3, 3] = 1
    mi = mitsuba()
    look = mi.ScalarTransform4f().look_at([0.5, 0.5, 4], [0.5, 0.5, 0.5], [0, 1, 0])
    scene = renderer.load_scene(
        {
            "type": "scene",
            "integrator": {"type": "volpath"},
            "sensor": {"type": "perspective", "fov": 10, "to_world": look},
            "sky": {"type": "constant"},
            "box": {
                "type": "cube",
                "to_world": mi.ScalarTransform4f().translate([0.5, 0.5, 0.5]).scale(0.5),
                "bsdf": {"type": "null"},
                "interior": grid_medium(data) | {"scale": 300.0},
            },
        },
        settings=renderer.Settings(width=8, height=8),
    )
    settings = scene.resolved(renderer.Settings(width=8, height=8), 4)
    *_, segments = scene.kernel(settings).launch(np.arange(64), np.zeros(64, int), 1)
    # A path is three or four segments without a medium; each collision in the densest voxel's rate adds one.
    assert segments.mean() / 4 < 12
