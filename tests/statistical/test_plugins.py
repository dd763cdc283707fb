"""Every kind of sensor, emitter, BSDF and shape that Mitsuba offers for surfaces: our image is that of `path`.

Compared are the mean of the image and the means of its blocks, each by Welch's test on independent runs of both.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import p_limit, variance_map
from scipy.stats import t as student

import renderer
from renderer.backend import mitsuba
from renderer.errors import FredholmError

mi = mitsuba()
T = mi.ScalarTransform4f
WIDTH, HEIGHT, BLOCK = 24, 16, 8
SPP = 512
PATH_RUNS, PATH_SPP = 12, 48
ROUNDING = 1e-5
DEPTH = 6


def film(width: int = WIDTH, height: int = HEIGHT, **more: Any) -> dict[str, Any]:
    return {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}} | more


def look(x: float = 0.4, y: float = -2.6, z: float = 1.3) -> Any:
    return T().look_at([x, y, z], [0, 0, 0.3], [0, 0, 1])


CAMERA = {"type": "perspective", "fov": 50, "to_world": look(), "film": film()}
FLOOR = {
    "type": "rectangle",
    "to_world": T().scale(3),
    "bsdf": {"type": "diffuse", "reflectance": {"type": "checkerboard", "to_uv": T().scale(5)}},
}
BALL = {"type": "sphere", "center": [0, 0, 0.5], "radius": 0.5, "bsdf": {"type": "diffuse", "reflectance": 0.7}}
LAMP = {
    "type": "rectangle",
    "to_world": T().look_at([1.2, -0.8, 2], [0, 0, 0.3], [0, 0, 1]).scale(0.5),
    "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [9, 7, 5]}},
}
SKY = {"type": "constant", "radiance": {"type": "rgb", "value": [0.3, 0.4, 0.5]}}


def scene(**parts: Any) -> dict[str, Any]:
    """A ball on a floor under a lamp and a sky, some of it replaced."""
    made = {"sensor": CAMERA, "floor": FLOOR, "ball": BALL, "lamp": LAMP, "sky": SKY} | parts
    kept = {k: v for k, v in made.items() if v is not None}
    return {"type": "scene", "integrator": {"type": "path", "max_depth": DEPTH}, **kept}


def gradient(channels: int = 3) -> Any:
    y, x = np.mgrid[0:16, 0:32]
    image = np.stack([0.2 + x / 32, 0.3 + y / 20, 0.5 + 0.3 * np.sin(x / 3)], axis=-1)[..., :channels]
    return mi.Bitmap(image.astype(np.float32))


def texture(**more: Any) -> dict[str, Any]:
    return {"type": "bitmap", "bitmap": gradient(), "raw": True} | more


def bumps() -> Any:
    y, x = np.mgrid[0:32, 0:32]
    return mi.Bitmap((0.5 + 0.2 * np.sin(x) * np.cos(y))[..., None].astype(np.float32))


def normals() -> Any:
    y, x = np.mgrid[0:32, 0:32]
    n = np.stack([0.25 * np.sin(x), 0.25 * np.cos(y), np.ones_like(x)], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return mi.Bitmap((0.5 + 0.5 * n).astype(np.float32))


def with_bsdf(bsdf: dict[str, Any]) -> dict[str, Any]:
    return scene(ball=BALL | {"bsdf": bsdf})


def only(emitter: dict[str, Any]) -> dict[str, Any]:
    return scene(lamp=None, sky=None, emitter=emitter)


TOWARDS = T().look_at([0.5, -1, 2.5], [0, 0, 0.4], [0, 0, 1])
SENSORS = {
    "perspective, crop window": lambda: scene(
        sensor=CAMERA | {"film": film(48, 40, crop_offset_x=13, crop_offset_y=11, crop_width=WIDTH, crop_height=HEIGHT)}
    ),
    "perspective, shifted": lambda: scene(
        sensor=CAMERA | {"principal_point_offset_x": 0.1, "principal_point_offset_y": -0.05}
    ),
    "thin lens": lambda: scene(
        sensor={"type": "thinlens", "fov": 50, "aperture_radius": 0.15, "focus_distance": 2.5}
        | {"to_world": look(), "film": film()}
    ),
    "orthographic": lambda: scene(
        sensor={"type": "orthographic", "to_world": look() @ T().scale([1.6, 1.6, 1]), "film": film()}
    ),
    "radiance meter": lambda: scene(sensor={"type": "radiancemeter", "to_world": look(), "film": film(1, 1)}),
    "distant, one direction": lambda: scene(
        sensor={"type": "distant", "direction": [0.2, 0.3, -1], "target": [0.1, 0, 0.5], "film": film(1, 1)}
    ),
    "distant, onto a shape": lambda: scene(
        sensor={
            "type": "distant",
            "direction": [0.2, 0.3, -1],
            "target": {"type": "rectangle", "to_world": T().scale(0.8)},
            "film": film(1, 1),
        }
    ),
    "batch of two": lambda: scene(
        sensor={
            "type": "batch",
            "film": film(2 * WIDTH, HEIGHT),
            "left": {"type": "perspective", "fov": 50, "to_world": look(-0.4)},
            "right": {"type": "perspective", "fov": 40, "to_world": look(0.4)},
        }
    ),
}
EMITTERS = {
    "point": lambda: only({"type": "point", "position": [0.6, -0.9, 2], "intensity": 6.0}),
    "spot": lambda: only({"type": "spot", "to_world": TOWARDS, "intensity": 20.0, "cutoff_angle": 25}),
    "textured spot": lambda: only(
        {"type": "spot", "to_world": TOWARDS, "intensity": 20.0, "cutoff_angle": 25, "texture": texture()}
    ),
    "directional": lambda: only({"type": "directional", "direction": [0.3, 0.4, -1], "irradiance": 2.0}),
    "projector": lambda: only(
        {"type": "projector", "to_world": TOWARDS, "irradiance": texture(), "fov": 40, "scale": 9.0}
    ),
    "constant": lambda: only({"type": "constant", "radiance": 0.8}),
    "environment map": lambda: only({"type": "envmap", "bitmap": gradient(), "scale": 1.5}),
    "sun and sky": lambda: only({"type": "sunsky", "sun_direction": [0.4, -0.3, 0.8], "turbidity": 4.0}),
    "textured area light": lambda: scene(lamp=LAMP | {"emitter": {"type": "area", "radiance": texture()}}),
    "light of every shape": lambda: scene(
        lamp=None,
        sky=None,
        a={"type": "sphere", "center": [1, -0.5, 1.5], "radius": 0.2, "emitter": {"type": "area", "radiance": 9.0}},
        b={"type": "disk", "emitter": {"type": "area", "radiance": 6.0}}
        | {"to_world": T().look_at([-1, -0.5, 1.6], [0, 0, 0], [0, 0, 1]).scale(0.3)},
        c={"type": "cylinder", "p0": [-1.2, 0.8, 0.3], "p1": [1.2, 0.8, 0.6], "radius": 0.1}
        | {"emitter": {"type": "area", "radiance": 3.0}},
        d={"type": "cube", "to_world": T().translate([0, -1, 0.1]).scale(0.1)}
        | {"emitter": {"type": "area", "radiance": 4.0}},
    ),
}
BSDFS = {
    "mask": {"type": "mask", "opacity": 0.4, "nested": {"type": "diffuse"}},
    "textured mask": {
        "type": "mask",
        "opacity": {"type": "checkerboard", "color0": 0.0, "color1": 1.0, "to_uv": T().scale(8)},
        "nested": {"type": "twosided", "nested": {"type": "plastic"}},
    },
    "null": {"type": "null"},
    "normal map": {
        "type": "normalmap",
        "normalmap": {"type": "bitmap", "raw": True, "bitmap": normals()},
        "nested": {"type": "roughconductor", "alpha": 0.3},
    },
    "bump map": {
        "type": "bumpmap",
        "arbitrary": {"type": "bitmap", "raw": True, "bitmap": bumps()},
        "scale": 0.1,
        "nested": {"type": "roughplastic", "alpha": 0.2},
    },
    "blend": {
        "type": "blendbsdf",
        "weight": {"type": "checkerboard", "to_uv": T().scale(6)},
        "a": {"type": "diffuse"},
        "b": {"type": "roughconductor", "alpha": 0.2},
    },
    "principled": {"type": "principled", "base_color": texture(), "roughness": 0.4, "metallic": 0.4, "clearcoat": 0.6}
    | {"sheen": 0.5, "spec_tint": 0.3, "anisotropic": 0.5},
    "principled glass": {"type": "principled", "roughness": 0.2, "spec_trans": 0.8, "eta": 1.4},
    "thin principled": {"type": "principledthin", "roughness": 0.4, "diff_trans": 0.7, "spec_trans": 0.4},
    "dielectric": {"type": "dielectric", "int_ior": 1.5},
    "rough dielectric": {"type": "roughdielectric", "alpha": 0.2},
    "thin dielectric": {"type": "thindielectric"},
    "conductor": {"type": "conductor", "material": "Au"},
    "rough conductor": {"type": "roughconductor", "material": "Cu", "alpha_u": 0.1, "alpha_v": 0.4},
    "plastic": {"type": "plastic", "diffuse_reflectance": texture()},
    "rough plastic": {"type": "roughplastic", "alpha": 0.15, "nonlinear": True},
    "two-sided": {"type": "twosided", "a": {"type": "diffuse"}, "b": {"type": "plastic"}},
    "hair": {"type": "hair"},
}


def sdf() -> Any:
    z, y, x = np.mgrid[0:16, 0:16, 0:16] / 15 - 0.5
    values = np.sqrt(x * x + y * y + 1.5 * z * z) - 0.35
    return mi.TensorXf(values.astype(np.float32)[..., None])


def instances() -> dict[str, Any]:
    group = {"type": "shapegroup", "one": BALL | {"radius": 0.25}, "two": {"type": "cube", "to_world": T().scale(0.15)}}
    places = [T().translate([x, 0.3 * x, 0.2]).rotate([0, 0, 1], 40 * x) for x in (-0.9, 0.0, 0.8)]
    copies = {
        f"copy{i}": {"type": "instance", "to_world": place, "group": {"type": "ref", "id": "group"}}
        for i, place in enumerate(places)
    }
    return scene(ball=None, group=group, **copies)


SHAPES = {
    "instances": instances,
    "signed distance grid": lambda: scene(
        ball={
            "type": "sdfgrid",
            "grid": sdf(),
            "to_world": T().translate([-0.5, -0.5, 0]),
            "bsdf": {"type": "twosided", "nested": {"type": "diffuse"}},
        }
    ),
    "cylinder and disk": lambda: scene(
        ball={"type": "cylinder", "p0": [0, 0, 0], "p1": [0, 0, 0.8], "radius": 0.4},
        lid={"type": "disk", "to_world": T().translate([0, 0, 0.8]).scale(0.4), "bsdf": {"type": "plastic"}},
    ),
    "hidden lights": lambda: scene() | {"integrator": {"type": "path", "max_depth": DEPTH, "hide_emitters": True}},
}
CASES = {
    **{f"sensor: {k}": v for k, v in SENSORS.items()},
    **{f"emitter: {k}": v for k, v in EMITTERS.items()},
    **{f"bsdf: {k}": (lambda v=v: with_bsdf(v)) for k, v in BSDFS.items()},
    **{f"shape: {k}": v for k, v in SHAPES.items()},
}


def blocks(values: np.ndarray) -> np.ndarray:
    """Means over blocks of pixels, and over the whole image: (n_blocks + 1, ...)."""
    height, width = values.shape[:2]
    rows, columns = max(1, height // BLOCK), max(1, width // BLOCK)
    parts = [
        part.mean(axis=(0, 1))
        for band in np.array_split(values, rows, axis=0)
        for part in np.array_split(band, columns, axis=1)
    ]
    return np.array([*parts, values.mean(axis=(0, 1))])


# Mitsuba's own render tests cover most BSDFs; all of them are compared by `make test-long`.
BY_DEFAULT = ("sensor", "emitter", "shape", "bsdf: textured mask", "bsdf: blend", "bsdf: principled", "bsdf: bump")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n.startswith(BY_DEFAULT) else pytest.mark.slow) for n in CASES]
)
def test_image_is_that_of_path(name: str, seed: int) -> None:
    description = CASES[name]()
    estimate = renderer.render(description, renderer.Target(spp=SPP), renderer.Settings(seed=seed, adaptive=False))
    assert estimate.invalid.sum() == 0
    plain: Any = mi.load_dict(CASES[name]())  # as Mitsuba sees it: nothing rewritten
    runs = []
    for run in range(PATH_RUNS):
        image: Any = mi.render(plain, spp=PATH_SPP, seed=seed % 2**20 + run)
        runs.append(blocks(np.array(image, np.float64)[..., :3]))
    theirs, their_variance = np.mean(runs, axis=0), np.var(runs, axis=0, ddof=1) / PATH_RUNS
    ours = blocks(estimate.mean)
    area = np.array([len(part) for part in _pixels(estimate)])[:, None]
    our_variance = blocks(variance_map(estimate)[..., :3]) / area
    assert ours.mean() > 1e-4  # there is something to see

    total = our_variance + their_variance + (ROUNDING * np.abs(theirs)) ** 2
    degrees = np.minimum(total**2 / (their_variance**2 / (PATH_RUNS - 1) + 1e-60), 1e6)
    p: np.ndarray = 2 * student.sf(np.abs(ours - theirs) / np.sqrt(total), degrees)
    worst = divmod(int(np.argmin(p)), ours.shape[1])
    assert p.min() > p_limit() / p.size, (
        f"block {worst}: ours {ours[worst]:.6g} ± {math.sqrt(our_variance[worst]):.2g}, path {theirs[worst]:.6g} ± "
        f"{math.sqrt(their_variance[worst]):.2g}; image {ours[-1]} and {theirs[-1]}"
    )


def _pixels(estimate: renderer.Estimate) -> list[np.ndarray]:
    """The pixels of each block, for their number."""
    height, width = estimate.height, estimate.width
    index = np.arange(height * width).reshape(height, width)
    bands = np.array_split(index, max(1, height // BLOCK), axis=0)
    parts = [part.ravel() for band in bands for part in np.array_split(band, max(1, width // BLOCK), axis=1)]
    return [*parts, index.ravel()]


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"glass": {"type": "sphere", "bsdf": {"type": "polarizer"}, "interior": {"type": "homogeneous"}}}, "polari"),
        ({"sky": {"type": "timed_sunsky"}}, "timed_sunsky"),
    ],
    ids=["polarised fog", "sky by time"],
)
def test_what_is_no_surface_light_transport_is_refused_by_name(parts: dict[str, Any], message: str) -> None:
    with pytest.raises(FredholmError, match=message):
        renderer.load_scene(scene(**parts))
