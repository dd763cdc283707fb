"""Facts about the EXR: it is the checkpoint to the last bit, any reader opens it, no failure harms an older file."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import renderer
from renderer.errors import CheckpointError
from renderer.estimate.correlation import Correlation
from renderer.estimate.error import image_error
from renderer.estimate.estimate import Estimate, Identity
from renderer.estimate.moments import STOKES, Moments
from renderer.image import exr

WIDTH, HEIGHT = 7, 5
N = WIDTH * HEIGHT
CHANNELS = {"R", "G", "B", "stderr.R", "stderr.G", "stderr.B", "stderr.Y", "count", "trust", "invalid"}


def estimate(moments: Moments | None = None) -> Estimate:
    if moments is None:
        rng = np.random.default_rng(0)
        moments = Moments.empty(N)
        for _ in range(12):
            invalid = (rng.random(N) < 0.05).astype(np.uint32)
            moments.add(slice(None), rng.gamma(2, 1, (N, 3)).astype(np.float32), invalid, 4, np.arange(N) + 4)
    identity = Identity("0123abcd" * 8, "Büchse", {"width": WIDTH, "height": HEIGHT, "technique": "mis"}, 2**63 - 1)
    return Estimate(WIDTH, HEIGHT, 4, moments, identity, seconds=0.1 + 0.2, ranges=((2**63 - 1, 12),))


def assert_same_bits(a: Moments, b: Moments) -> None:
    for field in fields(Moments):
        left, right = getattr(a, field.name), getattr(b, field.name)
        assert left.dtype == right.dtype
        assert left.tobytes() == right.tobytes(), field.name


def read_part(path: Path, part: int = 0) -> tuple[Any, np.ndarray]:
    """Spec and pixels of one part, as any program sees them."""
    source = oiio.ImageInput.open(str(path))
    assert source is not None
    spec = source.spec(part)
    pixels = source.read_image(part, 0, 0, spec.nchannels, spec.format)
    source.close()
    assert pixels is not None
    return spec, pixels


def test_what_was_written_is_read_back_bit_for_bit(tmp_path: Path) -> None:
    written = estimate()
    written.write(tmp_path / "a.exr")
    read = Estimate.read(tmp_path / "a.exr")
    assert_same_bits(read.moments, written.moments)
    for name in ("width", "height", "replicate_size", "identity", "seconds", "ranges"):
        assert getattr(read, name) == getattr(written, name), name


EXTREMES = [0.0, -0.0, 5e-324, 2.2e-308, 1e-300, 1e-20, 1 / 3, 65504.0, 1e20, 1e300, 1.7976931348623157e308]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # 1e300 does not fit the picture's float32, and need not
@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_every_float64_survives(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pick = lambda *shape: rng.choice(EXTREMES, shape) * rng.choice([1.0, -1.0], shape)  # noqa: E731
    whole = lambda: rng.integers(0, 2**40, N)  # noqa: E731
    moments = Moments(
        *(whole(), pick(N, 3), np.abs(pick(N, 4)), pick(N), whole(), np.abs(pick(N)), whole(), whole(), whole()),
        *((pick(N, STOKES), np.abs(pick(N, STOKES))) if seed % 2 else (np.zeros((N, 0)), np.zeros((N, 0)))),
    )
    estimate(moments).write(tmp_path / "a.exr")
    assert_same_bits(Estimate.read(tmp_path / "a.exr").moments, moments)


def test_a_file_from_before_segments_were_counted_is_still_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as older:
        whole = exr._exact_array
        older.setattr(exr, "FORMAT_VERSION", 2)
        older.setattr(exr, "MOMENT_CHANNELS", exr.NAMES_BY_FORMAT[2])
        older.setattr(exr, "_exact_array", lambda e: np.ascontiguousarray(whole(e)[..., :-2]))
        estimate().write(tmp_path / "a.exr")
    read, written = Estimate.read(tmp_path / "a.exr").moments, estimate().moments
    assert not read.segments.any()
    written.segments[:] = 0
    assert_same_bits(read, written)


def test_reading_and_writing_again_changes_nothing(tmp_path: Path) -> None:
    estimate().write(tmp_path / "a.exr")
    Estimate.read(tmp_path / "a.exr").write(tmp_path / "b.exr")
    assert_same_bits(Estimate.read(tmp_path / "b.exr").moments, estimate().moments)
    assert Estimate.read(tmp_path / "b.exr").identity == estimate().identity


def test_part_one_is_a_float_picture_with_its_errors_beside_it(tmp_path: Path) -> None:
    written = estimate()
    written.write(tmp_path / "a.exr")
    spec, pixels = read_part(tmp_path / "a.exr")
    assert (spec.width, spec.height, spec.format) == (WIDTH, HEIGHT, oiio.FLOAT)
    assert spec.channelnames[:3] == ("R", "G", "B")
    assert set(spec.channelnames) == CHANNELS
    channel = {name: pixels[..., i] for i, name in enumerate(spec.channelnames)}
    for i, c in enumerate("RGB"):
        np.testing.assert_array_equal(channel[c], written.mean[..., i].astype(np.float32))
    for i, c in enumerate("RGBY"):
        np.testing.assert_array_equal(channel[f"stderr.{c}"], written.stderr[..., i].astype(np.float32))
    for name in ("count", "trust", "invalid"):
        np.testing.assert_array_equal(channel[name], getattr(written, name).astype(np.float32))


@pytest.mark.parametrize("brightness", [1e-20, 1.0, 1e5, 1e20])
def test_radiance_beyond_half_floats_is_kept_in_the_picture(tmp_path: Path, brightness: float) -> None:
    moments = Moments.empty(N)
    for k in (1, 2):
        moments.add(slice(None), np.full((N, 3), k * brightness, np.float32), np.zeros(N, np.uint32), 4)
    estimate(moments).write(tmp_path / "a.exr")
    spec, pixels = read_part(tmp_path / "a.exr")
    np.testing.assert_allclose(pixels[..., :3], 1.5 * brightness, rtol=1e-6)
    np.testing.assert_allclose(pixels[..., spec.channelnames.index("stderr.R")], 0.5 * brightness, rtol=1e-6)


def test_pixels_without_samples_look_like_their_neighbours_but_count_nothing(tmp_path: Path) -> None:
    moments = Moments.empty(N)
    moments.add(np.array([0]), np.array([[1, 2, 3]], np.float32), np.zeros(1, np.uint32), 4)
    estimate(moments).write(tmp_path / "a.exr")
    spec, pixels = read_part(tmp_path / "a.exr")
    assert (pixels[..., :3] == [1, 2, 3]).all()
    assert pixels[..., spec.channelnames.index("count")].sum() == 1
    known = [i for i, name in enumerate(spec.channelnames) if not name.startswith("stderr")]
    assert np.isfinite(pixels[..., known]).all()


@pytest.mark.parametrize("replicates", [0, 1, 2])
def test_a_standard_error_that_is_not_known_is_infinite_and_never_zero(tmp_path: Path, replicates: int) -> None:
    moments = Moments.empty(N)
    for k in range(replicates):
        moments.add(slice(None), np.full((N, 3), 1.0 + k, np.float32), np.zeros(N, np.uint32), 4)
    estimate(moments).write(tmp_path / "a.exr")
    spec, pixels = read_part(tmp_path / "a.exr")
    for c in "RGBY":
        found = pixels[..., spec.channelnames.index(f"stderr.{c}")]
        assert (found == 0.5).all() if replicates == 2 else (found == np.inf).all()


def test_a_pixel_that_never_found_anything_does_not_know_its_error_and_the_picture_does(tmp_path: Path) -> None:
    """The right half is lit, the left is black: background, or a light that was not met. Half a picture of it is no
    reason to know nothing of the other half."""
    width = 8
    rng = np.random.default_rng(1)
    moments = Moments.empty(width * width)
    is_lit = np.arange(width * width) % width >= width // 2
    for _ in range(32):
        values = np.where(is_lit[:, None], rng.uniform(0.5, 1.5, (len(is_lit), 3)), 0.0)
        values[:, 2] = 0  # no blue in any of it
        moments.add(slice(None), values.astype(np.float32), np.zeros(len(is_lit), np.uint32), 4)
    written = replace(estimate(moments), width=width, height=width)
    written.write(tmp_path / "a.exr")
    written.write_picture(tmp_path / "b.exr")
    for name in ("a.exr", "b.exr"):
        spec, pixels = read_part(tmp_path / name)
        channel = {c: pixels[..., i].ravel() for i, c in enumerate(spec.channelnames)}
        for c in "RGBY":
            assert (channel[f"stderr.{c}"][~is_lit] == np.inf).all(), (name, c)
        believed = is_lit & (channel["trust"] == 1)
        assert believed.sum() > 8
        assert np.isfinite(channel["stderr.R"][is_lit]).all()
        assert (channel["stderr.B"][believed] == 0).all()  # well known to be nothing
        assert (channel["stderr.B"][is_lit & ~believed] == np.inf).all()
        assert spec.getattribute("fredholm:error") is not None
    again = Estimate.read(tmp_path / "a.exr")
    np.testing.assert_array_equal(again.stderr, written.stderr)
    assert written.pixel(0, 0).standard_error == (None, None, None, None)
    assert written.pixel(0, 0).interval is None
    assert written.pixel(width - 1, 4).interval is not None


def test_metadata_say_what_it_is_how_it_was_made_and_how_good_it_is(tmp_path: Path) -> None:
    written = estimate()
    written.write(tmp_path / "a.exr", {"stopped_by": "spp", "threads": 2, "hosts": ["a", "b"]})
    spec, _ = read_part(tmp_path / "a.exr")
    get = lambda name: spec.getattribute(f"fredholm:{name}")  # noqa: E731
    error = image_error(written.moments, written.width).error
    assert error is not None
    assert get("seed") == str(2**63 - 1)
    assert get("scene") == "Büchse"
    assert get("scene_digest") == "0123abcd" * 8
    assert json.loads(get("settings")) == written.identity.settings
    assert json.loads(get("ranges")) == [[2**63 - 1, 12]]
    assert get("spp") == pytest.approx(written.spp)
    assert get("samples") == str(written.samples)
    assert get("error") == pytest.approx(error)
    assert get("estimated_rel_mse") == pytest.approx(error**2)
    assert float(get("seconds")) == 0.1 + 0.2
    assert int(get("invalid")) == written.invalid.sum() > 0
    assert set(json.loads(get("versions"))) >= {"fredholm", "mitsuba", "drjit", "numpy"}
    assert (get("stopped_by"), get("threads"), json.loads(get("hosts"))) == ("spp", 2, ["a", "b"])


def test_the_bound_in_the_file_knows_that_pixels_share_samples(tmp_path: Path) -> None:
    """The one that the run has said: it is wider where neighbours have samples in common."""
    alone = estimate()
    settings = alone.identity.settings | {"correlation": [2, 6.0, 2.0]}
    shared = replace(alone, identity=replace(alone.identity, settings=settings))
    bounds = []
    for written in (alone, shared):
        written.write(tmp_path / "a.exr")
        bounds.append(read_part(tmp_path / "a.exr")[0].getattribute("fredholm:error_upper"))
    assert bounds[1] == pytest.approx(
        image_error(shared.moments, shared.width, correlation=Correlation(2, 6.0, 2.0)).upper
    )
    assert bounds[1] != pytest.approx(bounds[0])


def test_an_error_that_is_not_known_is_not_in_the_metadata(tmp_path: Path) -> None:
    estimate(Moments.empty(N)).write(tmp_path / "a.exr")
    spec, _ = read_part(tmp_path / "a.exr")
    for name in ("error", "error_upper", "estimated_rel_mse"):
        assert spec.getattribute(f"fredholm:{name}") is None
    why = spec.getattribute("fredholm:error_unknown")
    assert why == "not yet known: 0 % of the pixels have two replicates, 100 % no sample"


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (300, 2)])
def test_images_of_any_shape_survive(tmp_path: Path, size: tuple[int, int]) -> None:
    n = size[0] * size[1]
    moments = Moments.empty(n)
    moments.add(slice(None), np.random.default_rng(0).random((n, 3), np.float32), np.zeros(n, np.uint32), 4)
    replace(estimate(moments), width=size[0], height=size[1]).write(tmp_path / "a.exr")
    read = Estimate.read(tmp_path / "a.exr")
    assert (read.width, read.height) == size
    assert_same_bits(read.moments, moments)


def write_plain(path: Path, channels: tuple[str, ...] = ("R", "G", "B"), **attributes: Any) -> None:
    spec = oiio.ImageSpec(WIDTH, HEIGHT, len(channels), "float")
    spec.channelnames = channels
    for key, value in attributes.items():
        spec.attribute(f"fredholm:{key}", value)
    out = oiio.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), spec)
    assert out.write_image(np.zeros((HEIGHT, WIDTH, len(channels)), np.float32))
    out.close()


def test_an_exr_of_another_program_is_refused_as_such(tmp_path: Path) -> None:
    write_plain(tmp_path / "a.exr")
    with pytest.raises(CheckpointError, match=r"a\.exr.*not a Fredholm estimate"):
        Estimate.read(tmp_path / "a.exr")


def test_an_estimate_that_lost_its_moments_in_another_program_is_refused(tmp_path: Path) -> None:
    write_plain(tmp_path / "a.exr", format=2, seed="1")
    with pytest.raises(CheckpointError, match=r"a\.exr.*damaged"):
        Estimate.read(tmp_path / "a.exr")


def test_an_estimate_of_a_later_format_is_refused_with_both_numbers(tmp_path: Path) -> None:
    write_plain(tmp_path / "a.exr", format=99)
    with pytest.raises(CheckpointError, match=r"format 99.*reads 2"):
        Estimate.read(tmp_path / "a.exr")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.05, 0.2, 0.3, 0.5, 0.9, 0.9999])
def test_a_truncated_file_is_refused_by_name(tmp_path: Path, share: float) -> None:
    path = tmp_path / "a.exr"
    estimate().write(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(CheckpointError, match=r"a\.exr"):
        Estimate.read(path)


@pytest.mark.parametrize("content", [b"", b"hello", bytes(range(256)) * 40])
def test_a_file_that_is_no_image_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.exr").write_bytes(content)
    with pytest.raises(CheckpointError, match=r"a\.exr cannot be read"):
        Estimate.read(tmp_path / "a.exr")


def test_a_missing_file_and_a_folder_are_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "folder.exr").mkdir()
    for name in ("none.exr", "folder.exr"):
        with pytest.raises(CheckpointError, match=name):
            Estimate.read(tmp_path / name)


def test_writing_leaves_nothing_but_the_file(tmp_path: Path) -> None:
    estimate().write(tmp_path / "new" / "folder" / "a.exr")
    estimate().write(tmp_path / "new" / "folder" / "a.exr")
    assert [p.name for p in (tmp_path / "new" / "folder").iterdir()] == ["a.exr"]


def test_a_write_that_fails_halfway_keeps_the_old_file_and_leaves_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.exr"
    estimate().write(path)
    before = path.read_bytes()

    def full_disk(_: Estimate) -> np.ndarray:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("renderer.image.exr._exact_array", full_disk)
    with pytest.raises(OSError, match="No space left"):
        estimate().write(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


def test_a_folder_in_the_way_keeps_its_contents_and_gets_no_temporary_file(tmp_path: Path) -> None:
    (tmp_path / "a.exr").mkdir()
    (tmp_path / "a.exr" / "kept").touch()
    with pytest.raises(OSError, match=r"a\.exr"):
        estimate().write(tmp_path / "a.exr")
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]
    assert (tmp_path / "a.exr" / "kept").exists()


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"must end in \.exr"):
        estimate().write(tmp_path / "a.png")
    assert not list(tmp_path.iterdir())


def test_channels_on_request_are_named_in_the_file_and_read_back(tmp_path: Path) -> None:
    asked = ("albedo", "normal", "depth", "position", "shape_index")
    made = renderer.render("cornell-box", renderer.Target(spp=8), renderer.Settings(16, 12, channels=asked))
    made.write(tmp_path / "a.exr")
    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert source is not None
    assert {"albedo.R", "normal.Z", "depth", "position.X", "shape_index"} <= set(source.spec().channelnames)
    source.close()
    back = renderer.Estimate.read(tmp_path / "a.exr").channels
    assert set(back) == set(asked)
    assert all(np.array_equal(back[name], made.channels[name]) for name in asked)
    assert made.channels["depth"].shape == (12, 16, 1)


def test_estimates_with_and_without_channels_are_estimates_of_the_same_thing() -> None:
    small = lambda seed, **more: renderer.Settings(8, 8, seed=seed, **more)  # noqa: E731
    with_depth = renderer.render("cornell-box", renderer.Target(spp=8), small(1, channels=("depth",)))
    without = renderer.render("cornell-box", renderer.Target(spp=8), small(2))
    assert "depth" in renderer.merge(without, with_depth).channels


def test_an_unknown_channel_is_refused_by_name() -> None:
    with pytest.raises(renderer.errors.SettingsError, match="channel 'colour' is not known"):
        renderer.Settings(channels=("colour",))


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e9])
def test_a_pictures_standard_errors_are_never_flushed_to_zero_or_infinity(tmp_path: Path, scale: float) -> None:
    """Half precision holds them to three digits where its range allows that; else they stay whole."""
    rng = np.random.default_rng(1)
    moments = Moments.empty(64)
    for _ in range(4):
        values = (scale * rng.uniform(0.5, 1.5, (64, 3))).astype(np.float32)
        moments.add(slice(None), values, np.zeros(64, np.uint32), 4, np.ones(64, np.uint32))
    estimate = Estimate(8, 8, 4, moments, Identity("a" * 64, "a", {}, 0), ranges=((0, 4),))
    estimate.write_picture(tmp_path / "a.exr")
    image = oiio.ImageBuf(str(tmp_path / "a.exr"))
    names, pixels = list(image.spec().channelnames), image.get_pixels()
    assert pixels is not None
    for i, name in enumerate(("stderr.R", "stderr.G", "stderr.B", "stderr.Y")):
        assert pixels[..., names.index(name)] == pytest.approx(estimate.stderr[..., i], rel=1e-3)
    assert np.array_equal(np.stack([pixels[..., names.index(c)] for c in "RGB"], -1), estimate.filled())
    estimate.write_picture(tmp_path / "h.exr", half=True)
    half = oiio.ImageBuf(str(tmp_path / "h.exr"))
    pixels = half.get_pixels()
    assert pixels is not None
    found = pixels[..., [list(half.spec().channelnames).index(c) for c in "RGB"]]
    assert found == pytest.approx(estimate.filled(), rel=1e-3)
