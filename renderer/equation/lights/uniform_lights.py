"""Lights of uniform radiance on a quad or a sphere, sampled here instead of by a call to their plugins.

Enters: emitters. Leaves: a table with a row for each, and from it direction samples, densities and radiances in a few
instructions. A sphere is sampled by the cone it subtends, with 1 − cos written as sin²/(1 + cos): in float32 the plain
form is off by 7 % at a milliradian and black below a tenth of one. A quad is sampled by its area.
Sources: Shirley, Wang & Zimmerman 1996; pbrt-v4, section 6.2.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.equation.lights.group import Hit
from renderer.equation.lights.surface_lights import is_smooth, is_varying, normal_at
from renderer.equation.mueller import intensity
from renderer.equation.primitives import sphere_of, whole_plate_of
from renderer.equation.tables import table

mi: Any = mitsuba()

ON_SURFACE = 0.9998  # (radius / distance)² from which a point counts as lying on a sphere
ROW = 20  # numbers of a light


@dataclass(frozen=True, slots=True)
class _Light:
    """One row: centre and radius (negative if a sphere shines inwards, 0 for a quad), half edges, 1/area, a number that
    is not used, normal on the side that shines, radiance."""

    centre: Any
    radius: Any
    first: Any
    inverse_area: Any
    second: Any
    _: Any
    normal: Any
    radiance: Any


@dataclass(frozen=True)
class UniformShape:
    """A light of this kind, as a row of the table (see `_Light`)."""

    row: NDArray[np.float32]

    @classmethod
    def of(cls, emitter: Any, shape: Any) -> UniformShape | None:
        """None for all other lights."""
        if shape is None or emitter.class_name() != "AreaLight" or is_varying(emitter) or is_smooth(shape):
            return None
        row = np.zeros(ROW, np.float32)
        return cls(row) if _fill(row, emitter, shape) else None


class UniformLights:
    """The lights of this kind in a scene."""

    def __init__(self, lights: list[UniformShape]) -> None:
        rows = np.stack([light.row for light in lights])
        # A light alone becomes part of the code.
        self._alone = rows[0] if len(rows) == 1 else None
        self._rows = table(rows.ravel(), mi.Float) if self._alone is None else None
        self.has_spheres = bool((rows[:, 3] != 0).any())
        self.has_quads = bool((rows[:, 3] == 0).any())
        self.tells_radiance = not mi.is_spectral

    def sample(self, ref: Any, row: Any, emitter: Any, u: Any, active: Any) -> tuple[Any, Any]:
        """As `LightGroup.sample`."""
        light = self._light(row, active)
        ds = dr.zeros(mi.DirectionSample3f)
        if self.has_quads:
            ds.p = dr.fma(2 * u.x - 1, light.first, dr.fma(2 * u.y - 1, light.second, light.centre))
            ds.n = light.normal
        if self.has_spheres:
            p, n = _point_on_sphere(ref, u, light)
            is_sphere = light.radius != 0
            ds.p = dr.select(is_sphere, p, ds.p) if self.has_quads else p
            ds.n = dr.select(is_sphere, n, ds.n) if self.has_quads else n
        towards = ds.p - ref.p
        ds.dist = dr.norm(towards)
        ds.d = towards / ds.dist
        ds.emitter = emitter
        ds.pdf = dr.select(active & (ds.dist > 0), self._density(ref, ds, light), 0)
        shines = (dr.dot(ds.n, ds.d) < 0) & (ds.pdf > 0)
        if mi.is_spectral:
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.p, si.n, si.sh_frame = ds.p, ds.n, mi.Frame3f(ds.n)
            si.wi = si.to_local(-ds.d)
            si.time, si.wavelengths = ref.time, ref.wavelengths
            radiance = intensity(emitter.eval(si, active))
        else:
            radiance = light.radiance
        ds.pdf = dr.select(shines, ds.pdf, 0)
        return ds, dr.select(shines, radiance / ds.pdf, 0)

    def pdf(self, ref: Any, ds: Any, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.pdf`."""
        return self._density(ref, ds, self._light(hit.row, active))

    def emission(self, si: Any, hit: Hit, active: Any) -> Any:
        """As `LightGroup.emission`; not in spectral variants."""
        return dr.select(mi.Frame3f.cos_theta(si.wi) > 0, self._light(hit.row, active).radiance, 0)

    def _density(self, ref: Any, ds: Any, light: _Light) -> Any:
        by_area = dr.square(ds.dist) * light.inverse_area / dr.abs(dr.dot(ds.d, ds.n))
        if not self.has_spheres:
            return by_area
        is_outside, one_minus_cos = cone(light.centre - ref.p, dr.abs(light.radius))
        by_cone = dr.rcp(dr.two_pi * one_minus_cos)
        return dr.select(is_outside & (light.radius != 0), by_cone, by_area)

    def _light(self, row: Any, active: Any) -> _Light:
        a, b, c, d, e = (self._gathered(i, row, active) for i in range(5))
        radiance = mi.Color3f(e.x, e.y, e.z)
        return _Light(
            mi.Point3f(a.x, a.y, a.z), a.w, mi.Vector3f(b.x, b.y, b.z), b.w, mi.Vector3f(c.x, c.y, c.z), c.w,
            mi.Normal3f(d.x, d.y, d.z), mi.UnpolarizedSpectrum(radiance.x) if mi.is_monochromatic else radiance,
        )  # fmt: skip

    def _gathered(self, quarter: int, row: Any, active: Any) -> Any:
        if self._alone is not None:
            return mi.Vector4f(*map(float, self._alone[4 * quarter : 4 * quarter + 4]))
        return dr.gather(mi.Vector4f, self._rows, row * (ROW // 4) + quarter, active)


def _fill(row: NDArray[np.float32], emitter: Any, shape: Any) -> bool:
    """Whether the shape is a quad or a sphere, of which this then is the row."""
    if (ball := sphere_of(shape)) is not None:
        centre, radius = ball
        up = np.array([0.0, 0.0, radius])
        row[:3], row[3] = centre, radius if normal_at(shape, centre + up) @ up > 0 else -radius
        row[7] = 1 / (4 * np.pi * radius**2)
    elif (plate := whole_plate_of(shape)) is not None:
        centre, first, second = plate
        row[:3], row[4:7], row[8:11] = centre, first, second
        row[7] = 1 / (4 * np.linalg.norm(np.cross(first, second)))
        row[12:15] = np.array(shape.sample_position(0, mi.Point2f(0.3, 0.4)).n, np.float64).ravel()
    else:
        return False
    if mi.is_spectral:
        return True
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0, 0, 1)
    row[16:19] = np.array(intensity(emitter.eval(si)), np.float64).ravel()
    return True


def _point_on_sphere(ref: Any, u: Any, light: _Light) -> tuple[Any, Any]:
    """A point on a sphere and its normal: uniform in the cone that it subtends, or by area from inside or on it."""
    to_centre = light.centre - ref.p
    radius = dr.abs(light.radius)
    is_outside, one_minus_cos = cone(to_centre, radius)
    frame = mi.Frame3f(dr.normalize(to_centre))
    drop = u.x * one_minus_cos  # 1 − cosθ of the direction, exact for tiny cones
    sin_theta_2, sin_max_2 = drop * (2 - drop), one_minus_cos * (2 - one_minus_cos)
    sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
    # Angle at the centre between the point and the line of sight: stays exact where p − centre would cancel.
    ratio_2 = sin_theta_2 / sin_max_2
    cos_alpha = dr.clip(dr.sqrt(ratio_2 * sin_theta_2) + (1 - drop) * dr.safe_sqrt(1 - ratio_2), -1, 1)
    sin_alpha = dr.safe_sqrt(1 - dr.square(cos_alpha))
    n = frame.to_world(mi.Vector3f(sin_alpha * cos_phi, sin_alpha * sin_phi, -cos_alpha))
    n = dr.select(is_outside, n, mi.warp.square_to_uniform_sphere(u))
    return ref.p + (to_centre + radius * n), dr.select(light.radius > 0, n, -n)


def cone(to_centre: Any, radius: Any) -> tuple[Any, Any]:
    """Whether a sphere is seen from outside, and 1 − cos of the half angle of the cone it subtends.

    A point within 1e-4 of the surface counts as on it: rounding must not put it inside here and outside there.
    """
    sin_2 = dr.square(radius) / dr.squared_norm(to_centre)
    is_outside = sin_2 < ON_SURFACE
    return is_outside, dr.select(is_outside, sin_2 / (1 + dr.safe_sqrt(1 - sin_2)), 1)
