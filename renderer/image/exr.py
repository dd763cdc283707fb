"""The estimate as an EXR, through OpenImageIO: the checkpoint, which holds all, and the picture, which is small.

Both open in any viewer. Part one, float32: R G B (pixels without samples take their neighbours'), stderr.R/G/B/Y
(inf where unknown: `interval.standard_error`), count, trust, invalid, and on request albedo.R/G/B, normal.X/Y/Z, depth,
position.X/Y/Z, shape_index. Of polarised light also S0.R/G/B to S3.R/G/B, named as by Mitsuba's `stokes`, and their
standard errors, stderr.S0.R/G/B to stderr.S3.R/G/B; S0 is R G B once more.
Part two of a checkpoint, "moments": mean and m2 as the two 32-bit halves of their float64 bits, so that reading back
loses nothing. They do not compress (1.8 times, for a third of the time that rendering them took), and are not.
Of a part of a render that waits for earlier replicates, further parts hold these (`blocks.py`).
A picture has part one alone, compressed, its standard errors to three digits; it says which checkpoint belongs to it.
Metadata carries scene, settings, seed, error, seconds and versions under `fredholm:` names.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from renderer.audit.value import Audit
from renderer.backend import versions
from renderer.errors import CheckpointError, SettingsError, check_name
from renderer.estimate.blocks import Held
from renderer.estimate.contents import Contents, Identity
from renderer.estimate.forecast import Curve
from renderer.estimate.moments import Moments
from renderer.image.blocks import Part, parts_of, read_blocks
from renderer.settings import CHANNELS

Kind = TypeVar("Kind", bound=Contents)

PICTURE_CHANNELS = (
    "R",
    "G",
    "B",
    "stderr.R",
    "stderr.G",
    "stderr.B",
    "stderr.Y",
    "count",
    "trust",
    "invalid",
)
EXACT = (
    "mean.R",
    "mean.G",
    "mean.B",
    "m2.R",
    "m2.G",
    "m2.B",
    "m2.Y",
    "count",
    "nonzero",
    "largest",
    "invalid",
    "tried",
    "m3",
    "planned",
    "segments",
)
MOMENT_CHANNELS = tuple(f"{name}.{half}" for name in EXACT for half in ("low", "high"))
STOKES_CHANNELS = tuple(f"S{i}.{colour}" for i in range(4) for colour in "RGB")
STOKES_EXACT = tuple(f"{kind}.{name}" for kind in ("mean", "m2") for name in STOKES_CHANNELS[3:])
POLARISED_CHANNELS = MOMENT_CHANNELS + tuple(f"{name}.{half}" for name in STOKES_EXACT for half in ("low", "high"))
FORMAT_VERSION = 3
WITH_BLOCKS = 4  # of files that have them, which older readers would take for less than they are
WITH_STOKES = 5  # of polarised light, with blocks or without
NAMES_BY_FORMAT = {  # of the exact part
    2: MOMENT_CHANNELS[:-2],  # without segments: those of such a file count as none
    FORMAT_VERSION: MOMENT_CHANNELS,
    WITH_BLOCKS: MOMENT_CHANNELS,
    WITH_STOKES: POLARISED_CHANNELS,
}

HALF_RANGE = (2.0**-14, 65504.0)  # in which half precision has eleven bits
FLAT = frozenset({"count", "trust", "invalid"})  # compress by themselves
EXACT_CHANNELS = frozenset({"shape_index", "depth", "position"})  # half precision would make steps of them


def write_estimate(estimate: Contents, path: Path, metadata: dict[str, Any]) -> None:
    """Writes all of an estimate: it can be read back. Raises SettingsError for a name that is not UTF-8, and OSError
    with the cause."""
    check_name(path, "the output", SettingsError)
    _write_atomically(path, lambda temporary: _write_parts(estimate, temporary, metadata))


def write_picture(
    estimate: Contents, path: Path, metadata: dict[str, Any], *, half: bool, checkpoint: Path | None
) -> None:
    """Writes what people open: a few bytes a pixel. half: radiance in half precision. checkpoint: the file with all of
    it, in the same folder, for who reads the picture to go on from. Raises as `write_estimate`.
    """
    check_name(path, "the output", SettingsError)
    names, pixels = _picture_channels(estimate)
    spec = oiio.ImageSpec(estimate.width, estimate.height, len(names), "float")
    spec.channelnames = names
    spec.channelformats = tuple(
        "half" if _is_half(name, pixels[..., i], half) else "float" for i, name in enumerate(names)
    )
    spec.attribute("oiio:subimagename", "picture")
    spec.attribute("compression", "zip")
    described = _metadata(estimate, metadata) | {"kind": "picture", "checkpoint": checkpoint.name if checkpoint else ""}
    for key, value in described.items():
        spec.attribute(f"fredholm:{key}", value)

    def write(temporary: Path) -> None:
        out = oiio.ImageOutput.create(str(temporary))
        if not out:
            raise OSError(f"cannot write {path}: {oiio.geterror()}")
        try:
            if not (out.open(str(temporary), spec) and out.write_image(pixels)):
                raise OSError(f"cannot write {path}: {out.geterror()}")
        finally:
            out.close()

    _write_atomically(path, write)


def _is_half(name: str, values: NDArray[np.float32], is_asked: bool) -> bool:
    """Whether a channel of a picture is in half precision: standard errors always, unless that would make 0 or infinity
    of some, and radiance where it is asked for and can be.
    """
    kind = name.split(".")[0]
    if kind in FLAT or kind in EXACT_CHANNELS or not (is_asked or kind == "stderr"):
        return False
    sizes = np.abs(values[np.isfinite(values) & (values != 0)])
    low, high = HALF_RANGE
    return not sizes.size or bool(sizes.min() >= low and sizes.max() <= high)


def _write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Has `path` written under a temporary name, syncs it and renames it."""
    if path.suffix.lower() != ".exr":
        raise OSError(f"cannot write {path}: the name must end in .exr")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp.exr")
    try:
        write(temporary)
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _write_parts(estimate: Contents, path: Path, metadata: dict[str, Any]) -> None:
    h, w = estimate.height, estimate.width
    names, pixels = _picture_channels(estimate)
    picture = oiio.ImageSpec(w, h, len(names), "float")
    picture.channelnames = names
    picture.attribute("oiio:subimagename", "picture")
    picture.attribute("compression", "zips")
    described = _metadata(estimate, metadata)
    if estimate.audit is not None:
        described["audit"] = json.dumps(estimate.audit.as_dict())
    for key, value in described.items():
        picture.attribute(f"fredholm:{key}", value)
    moments_names = POLARISED_CHANNELS if estimate.moments.has_stokes else MOMENT_CHANNELS
    exact = oiio.ImageSpec(w, h, len(moments_names), "uint")
    exact.channelnames = moments_names
    exact.attribute("oiio:subimagename", "moments")
    exact.attribute("compression", "none" if _head(estimate).tried.any() else "zip")
    parts = [Part(picture, pixels), Part(exact, _exact_array(estimate))]
    parts += parts_of(estimate.held.waiting if estimate.held is not None else (), w, h)

    out = oiio.ImageOutput.create(str(path))
    if not out:
        raise OSError(f"cannot write {path}: {oiio.geterror()}")
    try:
        is_written = out.open(str(path), tuple(part.spec for part in parts))
        for i, part in enumerate(parts):
            is_written = is_written and (i == 0 or out.open(str(path), part.spec, "AppendSubimage"))
            is_written = is_written and out.write_image(part.values)
        if not is_written:
            raise OSError(f"cannot write {path}: {out.geterror()}")
    finally:
        out.close()


def _parts_of(channel: str) -> tuple[str, ...]:
    """Names in the file of a channel on request."""
    if channel == "alpha":
        return ("A",)  # where viewers look for it
    parts = {"albedo": "RGB", "normal": "XYZ", "position": "XYZ"}.get(channel)
    return tuple(f"{channel}.{part}" for part in parts) if parts else (channel,)


def _channels_of(source: Any, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
    """The channels on request that a file holds."""
    wanted = [channel for channel in CHANNELS if _parts_of(channel)[0] in names]
    if not wanted:
        return {}
    pixels = source.read_image(0, 0, 0, len(names), "float")
    if pixels is None:
        raise CheckpointError(f"the picture cannot be read ({source.geterror()})")
    return {
        channel: np.stack([pixels[..., names.index(part)] for part in _parts_of(channel)], axis=-1)
        for channel in wanted
    }


def _picture_channels(estimate: Contents) -> tuple[tuple[str, ...], NDArray[np.float32]]:
    """Names and values of part one, (H, W, n)."""
    more = (name for channel in sorted(estimate.channels) for name in _parts_of(channel))
    stokes = STOKES_CHANNELS if estimate.moments.has_stokes else ()
    errors = tuple(f"stderr.{name}" for name in stokes)
    return (*PICTURE_CHANNELS, *stokes, *errors, *more), _picture_array(estimate)


def _picture_array(estimate: Contents) -> NDArray[np.float32]:
    flags = [estimate.count, estimate.trust, estimate.invalid]
    channels = [estimate.filled(), _known(estimate.stderr), *(f[..., None].astype(np.float32) for f in flags)]
    if (errors := estimate.stokes_stderr) is not None:
        channels += [estimate.filled_stokes(), _known(errors).reshape(*errors.shape[:2], -1)]
    channels += [estimate.channels[name] for name in sorted(estimate.channels)]
    return np.ascontiguousarray(np.concatenate(channels, axis=-1))


def _known(errors: NDArray[np.float64]) -> NDArray[np.float32]:
    """Standard errors as files have them: infinite where they are not known."""
    return np.nan_to_num(errors, nan=np.inf, posinf=np.inf).astype(np.float32)


def _head(estimate: Contents) -> Moments:
    """Moments without the replicates that wait."""
    return estimate.moments if estimate.held is None else estimate.held.head


def _exact_array(estimate: Contents) -> NDArray[np.uint32]:
    m = _head(estimate)
    columns = [
        m.mean,
        m.m2,
        m.count[:, None],
        m.nonzero[:, None],
        m.largest[:, None],
        m.invalid[:, None],
        m.tried[:, None],
        m.m3[:, None],
        (np.zeros_like(m.tried) if estimate.planned is None else estimate.planned)[:, None],
        m.segments[:, None],
        m.stokes,
        m.stokes_m2,
    ]
    exact = np.concatenate([np.asarray(c, np.float64) for c in columns], axis=1)
    return np.ascontiguousarray(exact).view("<u4").reshape(estimate.height, estimate.width, -1)


def _metadata(estimate: Contents, extra: dict[str, Any]) -> dict[str, Any]:
    found = estimate.image_error
    error = found.error
    values: dict[str, Any] = {
        "format": WITH_STOKES
        if estimate.moments.has_stokes
        else FORMAT_VERSION
        if estimate.held is None
        else WITH_BLOCKS,
        "scene": estimate.identity.scene_name,
        "scene_digest": estimate.identity.scene,
        "settings": json.dumps(estimate.identity.settings, sort_keys=True),
        "seed": str(estimate.identity.seed),
        "ranges": json.dumps(estimate.ranges),
        "first": estimate.held.first if estimate.held is not None else 0,
        "blocks": len(estimate.held.waiting) if estimate.held is not None else 0,
        "replicate_size": estimate.replicate_size,
        "spp": float(estimate.spp),
        "samples": str(estimate.samples),
        "seconds": repr(float(estimate.seconds)),
        "invalid": str(int(estimate.moments.invalid.sum())),
        "share_trusted": float(estimate.trust.mean()),
        "health": json.dumps(estimate.health.as_dict()),
        "made_with": json.dumps(estimate.identity.made_with),
        "curve": json.dumps(estimate.curve.as_dict()),
        "versions": json.dumps(versions(), sort_keys=True),
    }
    if error is not None:
        values["error"] = float(error)
        values["estimated_rel_mse"] = float(error**2)
    if found.unknown is not None:
        values["error_unknown"] = found.unknown
    if found.upper is not None:
        values["error_upper"] = float(found.upper)
    return values | {k: v if isinstance(v, (int, float, str)) else json.dumps(v) for k, v in extra.items()}


def read_estimate(path: Path, kind: type[Kind]) -> Kind:
    """Reads an estimate of a kind back, bit for bit. Raises CheckpointError where the file is no estimate of ours."""
    check_name(path, "the estimate", CheckpointError)
    if not path.is_file():
        raise CheckpointError(f"{path}: no such file")
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise CheckpointError(f"{path} cannot be read: {oiio.geterror()}")
    try:
        spec = source.spec()
        get = lambda key: spec.getattribute(f"fredholm:{key}")  # noqa: E731
        if get("kind") == "picture":
            return _checkpoint_of(path, get, kind)
        if get("format") is None:
            raise CheckpointError(f"{path} is an image, but not a Fredholm estimate: it carries no moments")
        names = NAMES_BY_FORMAT.get(get("format"))
        if names is None:
            known = ", ".join(map(str, NAMES_BY_FORMAT))
            raise CheckpointError(f"{path} has estimate format {get('format')}; this version reads {known}")
        bits = source.read_image(1, 0, 0, len(names), "uint")
        if bits is None or bits.shape[-1] != len(names):
            raise CheckpointError(f"{path} is damaged: its moments cannot be read ({source.geterror()})")
        order = [source.spec(1).channelnames.index(name) for name in names]  # OpenEXR sorts channels
        exact = np.ascontiguousarray(bits[..., order], dtype="<u4").reshape(-1, len(names)).view("<f8")
        exact = np.pad(exact, ((0, 0), (0, max(0, len(EXACT) - exact.shape[1]))))
        moments = Moments(
            count=exact[:, 7].astype(np.int64),
            mean=exact[:, 0:3].copy("F"),
            m2=exact[:, 3:7].copy("F"),
            m3=exact[:, 12].copy(),
            nonzero=exact[:, 8].astype(np.int64),
            largest=exact[:, 9].copy(),
            invalid=exact[:, 10].astype(np.int64),
            tried=exact[:, 11].astype(np.int64),
            segments=exact[:, 14].astype(np.int64),
            stokes=exact[:, 15:24].copy("F"),
            stokes_m2=exact[:, 24:33].copy("F"),
        )
        held, size = None, int(get("replicate_size"))
        if get("format") == WITH_BLOCKS or (get("format") == WITH_STOKES and int(get("blocks"))):
            try:
                held = Held(moments, read_blocks(source, int(get("blocks")), 2, spec.width))
            except CheckpointError as damage:
                raise CheckpointError(f"{path} is damaged: {damage}") from None
        return kind(
            width=spec.width,
            height=spec.height,
            replicate_size=size,
            moments=moments if held is None else held.moments(size),
            held=held,
            identity=Identity(
                scene=get("scene_digest"),
                scene_name=get("scene"),
                settings=json.loads(get("settings")),
                seed=int(get("seed")),
                made_with=tuple(json.loads(get("made_with") or "[]")),
            ),
            curve=Curve.of(json.loads(get("curve"))) if get("curve") else Curve(),
            seconds=float(get("seconds")),
            notes={key: json.loads(get("health"))[key] for key in ("warnings", "cannot_see")},
            planned=exact[:, 13].astype(np.int64) if exact[:, 13].any() else None,
            channels=_channels_of(source, tuple(spec.channelnames)),
            ranges=tuple((int(s), int(n)) for s, n in json.loads(get("ranges"))),
            audit=Audit.from_dict(json.loads(audited)) if (audited := get("audit")) else None,
        )
    finally:
        source.close()


def merge_order_of(path: Path) -> tuple[tuple[int, ...], int]:
    """`merge_order` of the estimate in a file, without reading it: of the checkpoint of a picture, what that says.
    What is no estimate comes first, for reading it says what it is.
    """
    source = oiio.ImageInput.open(str(path)) if path.is_file() else None
    if source is None:
        return (), 0
    try:
        ranges = source.spec().getattribute("fredholm:ranges")
        first = source.spec().getattribute("fredholm:first")
    finally:
        source.close()
    return tuple(seed for seed, _ in json.loads(ranges)) if ranges else (), int(first or 0)


def read_alpha(path: Path) -> NDArray[np.float32] | None:
    """(H, W) alpha of a file that has it; None where there is no such file or channel."""
    source = oiio.ImageInput.open(str(path))
    if source is None:
        oiio.geterror()  # else it waits for who asks next
        return None
    try:
        names = tuple(source.spec().channelnames)
        found = source.read_image(0, 0, names.index("A"), names.index("A") + 1, "float") if "A" in names else None
        return None if found is None else found[..., 0]
    finally:
        source.close()


def _checkpoint_of(path: Path, get: Callable[[str], Any], kind: type[Kind]) -> Kind:
    """The estimate that a picture is of, from the checkpoint beside it. get: the picture's metadata by key."""
    lacks = f"{path} is a picture, without the moments that going on, merging and replaying need"
    if not get("checkpoint"):
        raise CheckpointError(f"{lacks}, and no checkpoint was written with it; render again with --checkpoint")
    beside = path.with_name(Path(get("checkpoint")).name)
    if not beside.is_file():
        raise CheckpointError(f"{lacks}; they are in its checkpoint {beside.name}: put that file beside it, or name it")
    found = read_estimate(beside, kind)
    told = (get("scene_digest"), get("settings"), json.loads(get("ranges"))[0][0])
    has = (found.identity.scene, json.dumps(found.identity.settings, sort_keys=True), found.ranges[0][0])
    if told != has or found.samples < int(get("samples")):
        raise CheckpointError(f"{lacks}, and {beside.name} beside it is of another render by now; name its checkpoint")
    return found
