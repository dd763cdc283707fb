"""What only a loaded scene tells of its lights and colours: that no kernel can be made with them, or that they are not
there. Mended or named."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.backend import mitsuba
from renderer.scene.vet.nodes import value_of


def unsampleable_light(scene: Any) -> str | None:
    """Why a scene cannot be rendered: a mesh whose light has a texture, and which has no coordinates for one."""
    mi = mitsuba()
    for shape in scene.shapes():
        if not shape.is_mesh() or not shape.is_emitter() or shape.has_vertex_texcoords():
            continue
        if mi.has_flag(shape.emitter().flags(), mi.EmitterFlags.SpatiallyVarying):
            return (
                f"the mesh {shape.id() or 'without a name'!r} is a light with a texture and has no texture "
                "coordinates; export it with them (UVs), or give the light one radiance"
            )
    return None


def make_maps_finite(scene: Any) -> tuple[str, ...]:
    """Sets texels of environment maps that are NaN or infinite to 0, in place, and returns named warnings: one of them
    would make every direction of the map NaN."""
    mi = mitsuba()
    warnings = []
    for emitter in scene.emitters():
        if emitter.class_name() != "EnvironmentMapEmitter":
            continue
        known = mi.traverse(emitter)
        data = np.array(known["data"], np.float32)
        is_bad: NDArray[np.bool_] = np.asarray(~np.isfinite(data).all(axis=-1))
        if not is_bad.any():
            continue
        n = int(is_bad[:, 1:-1].sum())  # there is a column more on either side
        data[is_bad] = 0
        known["data"] = type(known["data"])(data)
        known.update()
        warnings.append(
            f"environment map: {n} of its {data[..., 0].size - 2 * len(data)} texels are not finite and count as "
            "black; mend the picture"
        )
    return tuple(warnings)


def missing_attributes(state: Any, scene: Any) -> tuple[str, ...]:
    """A named warning for each attribute that a texture asks for and no mesh of the scene has: it is black."""
    wanted = [value_of(node, "name") for node in state.nodes if node.props.plugin_name() == "mesh_attribute"]
    if not wanted:
        return ()
    known = {str(key).rsplit(".", 1)[-1] for key in mitsuba().traverse(scene).keys()}  # noqa: SIM118 (no mapping)
    return tuple(
        f"mesh attribute: no mesh has {name!r}, which counts as black; mend its name, or export the mesh with it "
        "(PLY properties r, g, b make vertex_color)"
        for name in dict.fromkeys(wanted)
        if name not in known
    )
