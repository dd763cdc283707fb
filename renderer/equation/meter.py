"""Irradiance meters: what falls on a surface, per area, from all of its outer side.

Enters: Mitsuba's sensor and the shape that it is on. Leaves: a sensor whose paths begin at a vertex on that shape which
is white and diffuse, seen from outside: π times what such a surface sends back is the irradiance,

    E(p) = ∫ L(p, ωi) cosθi dωi.

So the light on the meter is found by all techniques, points and directions among them, which rays that start on the
surface cannot meet; Mitsuba's own meters leave those out. A film of several pixels divides the shape by its parameters,
as Mitsuba does; a pixel is the mean over its part. A batch of meters on several shapes has them side by side on its
film, in its order, each on the same share of the width.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from renderer.backend import mitsuba

mi: Any = mitsuba()

WHITE = {"type": "diffuse", "reflectance": {"type": "uniform", "value": 1.0}}


class IrradianceMeter:
    """What `PathKernel` asks of a sensor, and where its paths begin. sensor: Mitsuba's, on no shape; shapes: those that
    are metered, each alone, with an area that Mitsuba can sample; white: a BSDF as of `WHITE`.
    """

    def __init__(self, sensor: Any, shapes: Sequence[Any], white: Any) -> None:
        self.sensor, self.shapes, self.white = sensor, list(shapes), white

    def film(self) -> Any:
        """Mitsuba's."""
        return self.sensor.film()

    def get_medium(self) -> Any:
        """The one that it is in, outside of its shape; None where there is none."""
        return self.sensor.get_medium()

    def set_medium(self, medium: Any) -> None:
        """Says which."""
        self.sensor.set_medium(medium)

    def needs_aperture_sample(self) -> bool:
        """A point on the shape and its normal say where a path begins."""
        return False

    def shutter_open(self) -> Any:
        """As Mitsuba's."""
        return self.sensor.shutter_open()

    def shutter_open_time(self) -> Any:
        """As Mitsuba's."""
        return self.sensor.shutter_open_time()

    def vertex(self, ray: Any, position: Any, active: Any = True) -> tuple[Any, Any]:
        """The vertex on the shape that a camera ray stands for, and its BSDF. position: on the film, in [0, 1]²."""
        point = self._point(ray.time, position, active)
        si = mi.SurfaceInteraction3f(point, ray.wavelengths)
        si.sh_frame = mi.Frame3f(point.n)
        si.wi = mi.Vector3f(0, 0, 1)
        si.t = mi.Float(0)
        return si, mi.BSDFPtr(self.white)

    def _point(self, time: Any, position: Any, active: Any) -> Any:
        """The point on a shape that a place on the film stands for."""
        n = len(self.shapes)
        if n == 1:
            return self.shapes[0].sample_position(time, position, active)
        column = dr.minimum(mi.UInt32(position.x * n), n - 1)
        within = mi.Point2f(position.x * n - mi.Float(column), position.y)
        found = dr.zeros(mi.PositionSample3f)
        for k, shape in enumerate(self.shapes):
            is_own = active & (column == k)
            found = dr.select(column == k, shape.sample_position(time, within, is_own), found)
        return found

    def sample_ray(self, time: Any, u_wavelength: Any, position: Any, lens: Any, active: Any = True) -> tuple[Any, Any]:
        """A ray from the shape, by the cosine, and its weight: π, as the density is cosθ/π."""
        surface = dr.zeros(mi.SurfaceInteraction3f)
        wavelengths, weight = self.sensor.sample_wavelengths(surface, u_wavelength, active)
        ray = dr.zeros(mi.Ray3f)
        ray.time, ray.wavelengths = time, wavelengths
        si, _ = self.vertex(ray, position, active)
        ray.d = si.to_world(mi.warp.square_to_cosine_hemisphere(lens))
        ray.o = si.spawn_ray(ray.d).o
        ray.maxt = mi.Float(dr.largest(mi.Float))
        return ray, weight * dr.pi
