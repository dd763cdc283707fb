"""What only a loaded scene tells of its media: whether a camera or meter is inside one that it does not name.

Enters: a loaded scene, and a sensor with the medium that it names. Leaves: a named warning. The sensor's rays are
followed to the first surface they meet; where that has media, its near side says which one the ray was in.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.backend import mitsuba

RAYS = 16  # along an edge of the film
MOST = 0.5  # of the rays that meet a surface with media, above which their word is taken


def unnamed_medium(scene: Any, sensor: Any) -> tuple[str, ...]:
    """A warning where most rays of a sensor begin in a medium, and it says that it is in none or in another one."""
    import drjit as dr

    mi = mitsuba()
    lane = dr.arange(mi.UInt32, RAYS * RAYS)
    place = mi.Point2f((lane % RAYS + 0.5) / RAYS, (lane // RAYS + 0.5) / RAYS)
    turned = mi.Float(lane) * 0.618034
    lens = mi.Point2f((mi.Float(lane) + 0.5) / RAYS**2, turned - dr.floor(turned))
    ray, _ = sensor.sample_ray(float(sensor.shutter_open()), 0.5, place, lens, True)
    si: Any = scene.ray_intersect(ray)
    is_border = si.is_valid() & si.is_medium_transition()
    own = sensor.get_medium()
    near = np.array(dr.reinterpret_array(mi.UInt32, si.target_medium(-ray.d)))[np.array(is_border)]
    key = 0 if own is None else int(np.array(dr.reinterpret_array(mi.UInt32, mi.MediumPtr(own)))[0])
    if len(near) == 0:
        return ()
    keys, counts = np.unique(near, return_counts=True)
    found = int(keys[counts.argmax()])
    if found in (0, key) or counts.max() <= MOST * len(near):
        return ()
    what = "meter" if hasattr(sensor, "vertex") else "camera"
    known = {int(np.array(dr.reinterpret_array(mi.UInt32, mi.MediumPtr(m)))[0]): m for m in _media(scene)}
    name = known[found].id() if found in known else ""
    called = f"the medium {name!r}" if name and not name.startswith("_") else "a medium"
    how = f"it names {'no medium' if own is None else 'another one'}"
    mend = f'give it <ref id="{name}" name="medium"/>' if name else "give it that medium"
    if what == "meter":
        mend += ", or its shape that medium as exterior"
    return (
        f"{what} inside a medium: it is inside {called}, as the surfaces around it say, and {how}; it is rendered as "
        f"written, as if the medium began at what its rays meet first: {mend}",
    )


def _media(scene: Any) -> list[Any]:
    both = (medium for shape in scene.shapes() for medium in (shape.interior_medium(), shape.exterior_medium()))
    return [medium for medium in both if medium is not None]
