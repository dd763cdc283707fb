"""Parts that the built-in scenes share: Mitsuba dictionaries for cameras, surfaces, lamps and skies.

Enters: plain numbers in scene units. Leaves: plugin dictionaries, fresh on every call. Mitsuba is asked for only
where transforms and bitmaps are made, never at import. Shapes are limited to Mitsuba's parametric ones: no files,
and every shape stays movable by its `to_world`.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from renderer.backend import mitsuba

Vector: TypeAlias = tuple[float, float, float]
Plugin: TypeAlias = dict[str, Any]


def scene(sensor: Plugin, max_depth: int, contents: dict[str, Plugin], integrator: str = "path") -> Plugin:
    """A whole scene. `max_depth` is advice: deep enough that a deeper path changes nothing visible."""
    return {"type": "scene", "integrator": {"type": integrator, "max_depth": max_depth}, "sensor": sensor, **contents}


def camera(origin: Vector, target: Vector, fov: float, width: int, height: int) -> Plugin:
    """A pinhole camera, y upwards. `fov` is the horizontal angle of view in degrees."""
    mi = mitsuba()

    return {
        "type": "perspective",
        "fov": fov,
        "fov_axis": "x",
        "near_clip": 1e-3,
        "far_clip": 1e4,
        "to_world": mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=[0, 1, 0]),
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent"},
    }


def rgb(red: float, green: float, blue: float) -> Plugin:
    """A linear sRGB triple: a reflectance in 0 … 1, or a radiance in W·sr⁻¹·m⁻²."""
    return {"type": "rgb", "value": [red, green, blue]}


def scaled(colour: Vector, factor: float) -> Plugin:
    """`rgb` of a colour times a factor."""
    red, green, blue = colour
    return rgb(red * factor, green * factor, blue * factor)


def diffuse(red: float, green: float, blue: float) -> Plugin:
    """A matt surface, lit and seen from both sides."""
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(red, green, blue)}}


# Complex indices of refraction near 630, 530 and 465 nm, rounded (Johnson & Christy 1972; Rakić 1995 for Al).
_METALS: dict[str, tuple[Vector, Vector]] = {
    "gold": ((0.18, 0.42, 1.37), (3.42, 2.35, 1.77)),
    "copper": ((0.23, 1.00, 1.25), (3.42, 2.58, 2.36)),
    "silver": ((0.06, 0.05, 0.04), (4.28, 3.47, 2.80)),
    "aluminium": ((1.39, 0.91, 0.68), (7.65, 6.42, 5.65)),
}


def metal(name: str, alpha: float = 0.0) -> Plugin:
    """A conductor seen from both sides: polished where `alpha` is 0, else GGX of that roughness."""
    eta, k = _METALS[name]
    conductor: Plugin = {"type": "conductor", "eta": rgb(*eta), "k": rgb(*k)}
    if alpha > 0.0:
        conductor |= {"type": "roughconductor", "distribution": "ggx", "alpha": alpha}
    return {"type": "twosided", "bsdf": conductor}


def glass(index: float = 1.5) -> Plugin:
    """Clear polished glass in air."""
    return {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}


def glazed(colour: Vector) -> Plugin:
    """A coloured body under a slightly rough glaze."""
    return {"type": "roughplastic", "distribution": "ggx", "alpha": 0.1, "diffuse_reflectance": rgb(*colour)}


def rectangle(corner: Vector, u: Vector, v: Vector, **extra: Any) -> Plugin:
    """The rectangle with one corner and two perpendicular edges given; it faces along u × v."""
    mi = mitsuba()

    edge_u, edge_v = np.asarray(u, np.float64), np.asarray(v, np.float64)
    facing = np.cross(edge_u, edge_v)
    facing /= np.linalg.norm(facing)
    centre = np.asarray(corner, np.float64) + (edge_u + edge_v) / 2
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(_affine(edge_u / 2, edge_v / 2, facing, centre)),
        **extra,
    }


def block(corner: Vector, u: Vector, v: Vector, w: Vector, **extra: Any) -> Plugin:
    """The parallelepiped with one corner and three edges given, right-handed so that it faces outwards."""
    mi = mitsuba()

    edges = [np.asarray(edge, np.float64) / 2 for edge in (u, v, w)]
    centre = np.asarray(corner, np.float64) + edges[0] + edges[1] + edges[2]
    return {"type": "cube", "to_world": mi.ScalarTransform4f(_affine(*edges, centre)), **extra}


def sphere(centre: Vector, radius: float, **extra: Any) -> Plugin:
    """A sphere that faces outwards."""
    return {"type": "sphere", "center": list(centre), "radius": radius, **extra}


def upright_ring(foot: Vector, radius: float, height: float, bsdf: Plugin) -> Plugin:
    """An open cylinder that stands on `foot` and faces outwards."""
    turned = mitsuba().ScalarTransform4f().translate(list(foot)).rotate([1, 0, 0], -90)
    ends = {"p0": [0, 0, 0], "p1": [0, 0, height], "radius": radius}
    return {"type": "cylinder", **ends, "to_world": turned, "bsdf": bsdf}


def area_light(colour: Vector, radiance: float = 1.0) -> Plugin:
    """An emitter for a shape: radiance per channel = colour · radiance."""
    return {"type": "area", "radiance": scaled(colour, radiance)}


def sphere_light(centre: Vector, radius: float, colour: Vector, power: float) -> Plugin:
    """A lamp of given power: Φ = L · π · 4π r², so L = Φ / (4 π² r²) for colour (1, 1, 1)."""
    radiance = power / (4.0 * math.pi**2 * radius**2)
    lamp = {"type": "diffuse", "reflectance": rgb(0.0, 0.0, 0.0)}
    return sphere(centre, radius, bsdf=lamp, emitter=area_light(colour, radiance))


def sky(radiance: npt.NDArray[np.float32]) -> Plugin:
    """An environment emitter from a map made in code; radiance: (H, W, 3) float32, row 0 straight up."""
    mi = mitsuba()

    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(radiance, np.float32))}


def sky_directions(height: int) -> npt.NDArray[np.float64]:
    """Unit vectors (H, 2H, 3) at which the texels of a `sky` map of that height are seen, y upwards."""
    theta = (np.arange(height) + 0.5) / height * math.pi
    phi = (np.arange(2 * height) + 0.5) / (2 * height) * 2.0 * math.pi
    sin_theta = np.sin(theta)[:, None]
    # Mitsuba's envmap: u = atan2(x, −z) / 2π, v = acos(y) / π.
    x, z = np.sin(phi) * sin_theta, -np.cos(phi) * sin_theta
    return np.stack([x, np.broadcast_to(np.cos(theta)[:, None], x.shape), z], axis=-1)


def _affine(*columns: npt.NDArray[np.float64]) -> list[list[float]]:
    """The 4 × 4 matrix whose first three rows are these four columns."""
    matrix = np.eye(4)
    matrix[:3, :] = np.stack(columns, axis=1)
    return matrix.tolist()
