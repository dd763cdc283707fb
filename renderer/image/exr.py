"""The estimate as an EXR, through OpenImageIO. The file opens in any viewer; it is also the checkpoint.

Part one, float32: R G B (pixels without samples take their neighbours'), stderr.R/G/B/Y, count, trust, invalid, and
on request albedo.R/G/B, normal.X/Y/Z, depth, position.X/Y/Z, shape_index.
Part two, "moments": mean and m2 as the two 32-bit halves of their float64 bits, so that reading back loses nothing.
Metadata carries scene, settings, seed, error, seconds and versions under `fredholm:` names.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from renderer.backend import versions
from renderer.errors import CheckpointError
from renderer.estimate.error import image_error
from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.moments import Moments
from renderer.settings import CHANNELS

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
FORMAT_VERSION = 3
OLDER = {2: MOMENT_CHANNELS[:-2]}  # without segments: those of such a file count as none


def write_estimate(estimate: Estimate, path: Path, metadata: dict[str, Any]) -> None:
    """Writes `path` under a temporary name, syncs it and renames it. Raises OSError with the cause."""
    if path.suffix.lower() != ".exr":
        raise OSError(f"cannot write {path}: the name must end in .exr")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp.exr")
    try:
        _write_parts(estimate, temporary, metadata)
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _write_parts(estimate: Estimate, path: Path, metadata: dict[str, Any]) -> None:
    h, w = estimate.height, estimate.width
    names = (*PICTURE_CHANNELS, *(name for channel in sorted(estimate.channels) for name in _parts_of(channel)))
    picture = oiio.ImageSpec(w, h, len(names), "float")
    picture.channelnames = names
    picture.attribute("oiio:subimagename", "picture")
    picture.attribute("compression", "zips")
    for key, value in _metadata(estimate, metadata).items():
        picture.attribute(f"fredholm:{key}", value)
    exact = oiio.ImageSpec(w, h, len(MOMENT_CHANNELS), "uint")
    exact.channelnames = MOMENT_CHANNELS
    exact.attribute("oiio:subimagename", "moments")
    exact.attribute("compression", "none")

    out = oiio.ImageOutput.create(str(path))
    if not out:
        raise OSError(f"cannot write {path}: {oiio.geterror()}")
    try:
        if not (
            out.open(str(path), (picture, exact))
            and out.write_image(_picture_array(estimate))
            and out.open(str(path), exact, "AppendSubimage")
            and out.write_image(_exact_array(estimate))
        ):
            raise OSError(f"cannot write {path}: {out.geterror()}")
    finally:
        out.close()


def _parts_of(channel: str) -> tuple[str, ...]:
    """Names in the file of a channel on request."""
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


def _picture_array(estimate: Estimate) -> NDArray[np.float32]:
    stderr = np.nan_to_num(estimate.stderr, nan=0.0).astype(np.float32)
    flags = [estimate.count, estimate.trust, estimate.invalid]
    channels = [estimate.filled(), stderr, *(f[..., None].astype(np.float32) for f in flags)]
    channels += [estimate.channels[name] for name in sorted(estimate.channels)]
    return np.ascontiguousarray(np.concatenate(channels, axis=-1))


def _exact_array(estimate: Estimate) -> NDArray[np.uint32]:
    m = estimate.moments
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
    ]
    exact = np.concatenate([np.asarray(c, np.float64) for c in columns], axis=1)
    return np.ascontiguousarray(exact).view("<u4").reshape(estimate.height, estimate.width, -1)


def _metadata(estimate: Estimate, extra: dict[str, Any]) -> dict[str, Any]:
    found = image_error(estimate.moments, estimate.width, is_trust_wanted=False)
    error = found.error
    values: dict[str, Any] = {
        "format": FORMAT_VERSION,
        "scene": estimate.identity.scene_name,
        "scene_digest": estimate.identity.scene,
        "settings": json.dumps(estimate.identity.settings, sort_keys=True),
        "seed": str(estimate.identity.seed),
        "ranges": json.dumps(estimate.ranges),
        "replicate_size": estimate.replicate_size,
        "spp": float(estimate.spp),
        "samples": str(estimate.samples),
        "seconds": repr(float(estimate.seconds)),
        "invalid": str(int(estimate.moments.invalid.sum())),
        "share_trusted": float(estimate.trust.mean()),
        "health": json.dumps(estimate.health.as_dict()),
        "versions": json.dumps(versions(), sort_keys=True),
    }
    if error is not None:
        values["error"] = float(error)
        values["estimated_rel_mse"] = float(error**2)
    if found.upper is not None:
        values["error_upper"] = float(found.upper)
    return values | {k: v if isinstance(v, (int, float, str)) else json.dumps(v) for k, v in extra.items()}


def read_estimate(path: Path) -> Estimate:
    """Reads an estimate back, bit for bit. Raises CheckpointError where the file is no estimate of ours."""
    if not path.is_file():
        raise CheckpointError(f"{path}: no such file")
    source = oiio.ImageInput.open(str(path))
    if source is None:
        raise CheckpointError(f"{path} cannot be read: {oiio.geterror()}")
    try:
        spec = source.spec()
        get = lambda key: spec.getattribute(f"fredholm:{key}")  # noqa: E731
        if get("format") is None:
            raise CheckpointError(f"{path} is an image, but not a Fredholm estimate: it carries no moments")
        names = MOMENT_CHANNELS if get("format") == FORMAT_VERSION else OLDER.get(get("format"))
        if names is None:
            known = ", ".join(map(str, (*OLDER, FORMAT_VERSION)))
            raise CheckpointError(f"{path} has estimate format {get('format')}; this version reads {known}")
        bits = source.read_image(1, 0, 0, len(names), "uint")
        if bits is None or bits.shape[-1] != len(names):
            raise CheckpointError(f"{path} is damaged: its moments cannot be read ({source.geterror()})")
        order = [source.spec(1).channelnames.index(name) for name in names]  # OpenEXR sorts channels
        exact = np.ascontiguousarray(bits[..., order], dtype="<u4").reshape(-1, len(names)).view("<f8")
        if len(names) < len(MOMENT_CHANNELS):
            exact = np.pad(exact, ((0, 0), (0, len(EXACT) - exact.shape[1])))
        return Estimate(
            width=spec.width,
            height=spec.height,
            replicate_size=int(get("replicate_size")),
            moments=Moments(
                count=exact[:, 7].astype(np.int64),
                mean=exact[:, 0:3].copy("F"),
                m2=exact[:, 3:7].copy("F"),
                m3=exact[:, 12].copy(),
                nonzero=exact[:, 8].astype(np.int64),
                largest=exact[:, 9].copy(),
                invalid=exact[:, 10].astype(np.int64),
                tried=exact[:, 11].astype(np.int64),
                segments=exact[:, 14].astype(np.int64),
            ),
            identity=Identity(
                scene=get("scene_digest"),
                scene_name=get("scene"),
                settings=json.loads(get("settings")),
                seed=int(get("seed")),
            ),
            seconds=float(get("seconds")),
            notes={key: json.loads(get("health"))[key] for key in ("warnings", "cannot_see")},
            planned=exact[:, 13].astype(np.int64) if exact[:, 13].any() else None,
            channels=_channels_of(source, tuple(spec.channelnames)),
            ranges=tuple((int(s), int(n)) for s, n in json.loads(get("ranges"))),
        )
    finally:
        source.close()
