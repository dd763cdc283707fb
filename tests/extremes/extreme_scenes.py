"""Scenes written at any scale and place, as text: what the compiler makes of them is not used to make them."""

from __future__ import annotations

from pathlib import Path

_QUADS = {
    "floor": ("1 0 0 0  0 0 -1 0  0 1 0 0  0 0 0 1", "0 0 0", "white"),
    "ceiling": ("1 0 0 0  0 0 1 0  0 -1 0 0  0 0 0 1", "0 2 0", "white"),
    "back": ("1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1", "0 1 -1", "white"),
    "left": ("0 0 1 0  0 1 0 0  -1 0 0 0  0 0 0 1", "-1 1 0", "red"),
    "right": ("0 0 -1 0  0 1 0 0  1 0 0 0  0 0 0 1", "1 1 0", "green"),
}


def _head(k: float, offset: float, origin: str, target: str, depth: int) -> str:
    return f"""<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="{depth}"/></integrator>
<sensor type="perspective"><float name="fov" value="38"/>
<float name="near_clip" value="{0.01 * k!r}"/><float name="far_clip" value="{1e4 * k!r}"/>
<transform name="to_world"><lookat origin="{origin}" target="{target}" up="0, 1, 0"/>{_shifted(k, offset)}</transform>
<film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="24"/>
<rfilter type="box"/></film></sensor>"""


def _shifted(k: float, offset: float, place: str = "0 0 0") -> str:
    """Steps of a transform: moves by k·place and by the offset. The sensor's scale goes into its place alone."""
    x, y, z = (k * float(c) + offset for c in place.split())
    return f'<translate x="{x!r}" y="{y!r}" z="{z!r}"/>'


def _eye(k: float, xyz: tuple[float, float, float]) -> str:
    return ", ".join(repr(k * c) for c in xyz)


def cornell_box(k: float = 1.0, offset: float = 0.0) -> str:
    """A Cornell box k units across, moved by `offset` along each axis: closed but for its front."""
    colours = {"white": "0.7, 0.7, 0.7", "red": "0.6, 0.1, 0.1", "green": "0.1, 0.5, 0.1"}
    shapes = []
    for matrix, place, colour in _QUADS.values():
        shapes.append(
            f'<shape type="rectangle"><transform name="to_world"><matrix value="{matrix}"/><scale value="{k!r}"/>'
            f'{_shifted(k, offset, place)}</transform><bsdf type="twosided"><bsdf type="diffuse">'
            f'<rgb name="reflectance" value="{colours[colour]}"/></bsdf></bsdf></shape>'
        )
    for place, size, turn in (("-0.35 0.6 -0.3", "0.3 0.6 0.3", 17), ("0.35 0.3 0.3", "0.3 0.3 0.3", -17)):
        x, y, z = (k * float(c) for c in size.split())
        shapes.append(
            f'<shape type="cube"><transform name="to_world"><scale x="{x!r}" y="{y!r}" z="{z!r}"/>'
            f'<rotate y="1" angle="{turn}"/>{_shifted(k, offset, place)}</transform>'
            '<bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.7, 0.7"/></bsdf></shape>'
        )
    light = (
        f'<shape type="rectangle"><transform name="to_world"><matrix value="{_QUADS["ceiling"][0]}"/>'
        f'<scale value="{0.25 * k!r}"/>{_shifted(k, offset, "0 1.98 0")}</transform>'
        '<emitter type="area"><rgb name="radiance" value="15, 13, 9"/></emitter></shape>'
    )
    head = _head(k, offset, _eye(k, (0, 1, 5.2)), _eye(k, (0, 1, 0)), 6)
    return head + "".join(shapes) + light + "</scene>"


def sphere_light(k: float = 1.0, offset: float = 0.0) -> str:
    """A floor and a ball under a small sphere light."""
    floor = (
        f'<shape type="rectangle"><transform name="to_world"><matrix value="{_QUADS["floor"][0]}"/>'
        f'<scale value="{2 * k!r}"/>{_shifted(k, offset)}</transform></shape>'
    )
    balls = "".join(
        f'<shape type="sphere"><float name="radius" value="{radius * k!r}"/><transform name="to_world">'
        f"{_shifted(k, offset, place)}</transform>{inner}</shape>"
        for radius, place, inner in (
            (0.4, "0 0.401 0", ""),
            (0.1, "1 1.6 0.5", '<emitter type="area"><rgb name="radiance" value="40"/></emitter>'),
        )
    )
    return _head(k, offset, _eye(k, (0, 1.2, 3.5)), _eye(k, (0, 0.3, 0)), 4) + floor + balls + "</scene>"


SCENES = {"cornell-box": cornell_box, "sphere-light": sphere_light}


def written(folder: Path, name: str, k: float = 1.0, offset: float = 0.0) -> Path:
    """The scene file of one of `SCENES`."""
    path = folder / f"{name}-{k:g}-{offset:g}.xml"
    path.write_text(SCENES[name](k, offset))
    return path
