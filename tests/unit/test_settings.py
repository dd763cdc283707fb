"""Facts about settings and targets: bad ones are refused when built, by name, value and range."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from renderer.errors import FredholmError, SettingsError
from renderer.settings import TECHNIQUES, Settings, Target, replicate_size_for


@pytest.mark.parametrize(
    ("field", "value", "value_range"),
    [
        *((side, bad, "1 to 16384") for side in ("width", "height") for bad in (0, -1, 16385, 10**30, 1.0, "8", True)),
        *(("seed", bad, f"0 to {2**63 - 1}") for bad in (-1, 2**63, 0.5, None, "7", False)),
        *(("max_depth", bad, "-1 to 1000000") for bad in (-2, 1_000_001, 3.0, True)),
        *(("technique", bad, "mis, bsdf, emitter, cosine, uniform") for bad in ("path", "MIS", "", None, 3, ["mis"])),
        *(("replicate_size", bad, "1 to 64") for bad in (0, -4, 65, 128, 4.0, True)),
        *(("replicate_size", bad, "power of two up to 64") for bad in (3, 48, 63)),
    ],
)
def test_a_bad_setting_is_refused_by_name_value_and_range(field: str, value: Any, value_range: str) -> None:
    with pytest.raises(SettingsError) as refusal:
        Settings(**{field: value})
    message = str(refusal.value)
    assert message.startswith(f"{field} is {value!r};")
    assert value_range in message


@pytest.mark.parametrize(
    ("field", "value", "value_range"),
    [
        *(("error", bad, "1e-06 to 10") for bad in (0, 0.0, -0.1, 1e-7, 10.5, math.nan, math.inf, "2%", True)),
        *(("seconds", bad, "0.001 to 1e+08") for bad in (0, -1.0, 1e9, math.nan, -math.inf, "30s", False)),
        *(("confidence", bad, "0.5 to 0.9999") for bad in (0, 0.4, 1, 1.5, math.nan, "95%", True)),
        *(("share", bad, "0.01 to 0.9999") for bad in (0, 1, -0.5, "all", True)),
        *(("spp", bad, f"1 to {2**31}") for bad in (0, -1, 2**31 + 1, 16.0, math.nan, "16", True)),
    ],
)
def test_a_bad_target_is_refused_by_name_value_and_range(field: str, value: Any, value_range: str) -> None:
    with pytest.raises(SettingsError) as refusal:
        Target(**({"error": 0.1} if field in ("confidence", "share") else {}), **{field: value})
    message = str(refusal.value)
    assert message.startswith(f"{field} is {value!r};")
    assert value_range in message


@pytest.mark.parametrize("kind", [np.int8, np.int64, np.uint16, np.uint64])
def test_whole_numbers_of_numpy_are_taken_as_python_s_own(kind: type[np.integer]) -> None:
    settings = Settings(*(kind(8) for _ in range(4)), replicate_size=kind(4), adaptive=np.bool_(False))  # type: ignore[arg-type]
    assert settings == Settings(8, 8, 8, 8, replicate_size=4, adaptive=False)
    target = Target(spp=kind(16), error=np.float32(0.5), seconds=np.float16(2), share=np.float64(0.5))  # type: ignore[arg-type]
    assert target == Target(spp=16, error=0.5, seconds=2.0, share=0.5)
    assert Target(error=0.1, region=[kind(1)] * 4) == Target(error=0.1, region=[1, 1, 1, 1])
    assert json.loads(json.dumps([settings.as_dict(), target.as_dict()]))[1]["spp"] == 16


@pytest.mark.parametrize("bad", [np.int64(0), np.float64(16.0), np.bool_(True), np.array([16])])
def test_what_is_no_whole_number_is_none_from_numpy_either(bad: Any) -> None:
    with pytest.raises(SettingsError, match="spp is"):
        Target(spp=bad)


@pytest.mark.parametrize("field", ["error", "seconds"])
def test_a_whole_number_too_large_for_a_float_is_refused_like_any_other(field: str) -> None:
    with pytest.raises(SettingsError, match=field):
        Target(**{field: 10**400})


def test_an_empty_target_is_refused_with_what_to_give() -> None:
    with pytest.raises(SettingsError, match="error, seconds or spp"):
        Target()


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"width": 1, "height": 16384},
        {"seed": 2**63 - 1},
        {"max_depth": -1},
        *({"technique": technique} for technique in TECHNIQUES),
        *({"replicate_size": 2**k} for k in range(7)),
    ],
)
def test_good_settings_are_kept_as_given(values: dict[str, Any]) -> None:
    settings = Settings(**values)
    assert {k: v for k, v in settings.as_dict().items() if k in values} == values
    assert Settings(**settings.as_dict()) == settings


@pytest.mark.parametrize(
    "values",
    [
        {"error": 1e-6},
        {"error": 10},
        {"seconds": 1e-3},
        {"spp": 2**31, "error": 0.5},
        {"error": 0.1, "confidence": 0.99, "share": 0.9, "region": [1, 2, 3, 4]},
    ],
)
def test_good_targets_are_kept_as_given(values: dict[str, Any]) -> None:
    nothing = {"error": None, "seconds": None, "spp": None, "confidence": None, "share": None, "region": None}
    confidence = {"confidence": 0.95} if "error" in values else {}
    assert Target(**values).as_dict() == nothing | confidence | values
    assert Target(**Target(**values).as_dict()) == Target(**values)


@pytest.mark.parametrize(("field", "value"), [("confidence", 0.9), ("share", 0.5), ("region", [0, 0, 4, 4])])
def test_what_is_said_about_an_error_needs_an_error(field: str, value: Any) -> None:
    with pytest.raises(SettingsError, match=f"{field} is given without an error"):
        Target(spp=16, **{field: value})


@pytest.mark.parametrize("bad", [0, "yes", None])
def test_adaptive_is_true_or_false(bad: Any) -> None:
    with pytest.raises(SettingsError, match="adaptive is"):
        Settings(adaptive=bad)


def test_settings_and_targets_do_not_change() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().seed = 1  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        Target(spp=1).spp = 2  # type: ignore[misc]


def test_a_refusal_can_be_caught_as_a_value_error_and_as_ours() -> None:
    assert issubclass(SettingsError, ValueError)
    assert issubclass(SettingsError, FredholmError)


@pytest.mark.parametrize(
    ("spp", "size"),
    [
        (1, 1),
        (4, 1),
        (7, 1),
        (8, 2),
        (15, 2),
        (16, 4),
        (31, 4),
        (32, 8),
        (63, 8),
        (64, 16),
        (65, 16),
        (4096, 16),
        (None, 16),
    ],
)
def test_few_samples_get_small_replicates_so_that_four_are_left(spp: int | None, size: int) -> None:
    target = Target(spp=spp, error=0.05)
    assert replicate_size_for(Settings(), target) == size
    assert spp is None or spp < 4 or spp // size >= 4


@pytest.mark.parametrize(
    ("spp", "size"),
    [
        *((31, 4), (63, 4), (64, 4), (127, 4), (128, 8), (255, 8), (256, 16), (511, 16)),
        *((512, 32), (1023, 32), (1024, 64), (2**20, 64)),
    ],
)
def test_from_64_samples_on_sixteen_replicates_are_left_so_that_a_pixel_can_be_trusted(spp: int, size: int) -> None:
    assert replicate_size_for(Settings(), Target(spp=spp)) == size
    assert replicate_size_for(Settings(), Target(spp=spp, seconds=1e6)) == size
    assert spp < 64 or spp // size >= 16


def test_a_time_leaves_the_size_to_the_pace_up_to_what_the_rest_of_the_target_says() -> None:
    assert replicate_size_for(Settings(), Target(seconds=2)) == 64
    assert replicate_size_for(Settings(), Target(seconds=2, error=0.01)) == 16


@pytest.mark.parametrize(("error", "size"), [(0.001, 16), (0.05, 16), (0.07, 8), (0.1, 4), (0.2, 2), (5.0, 2)])
def test_a_loose_error_gets_small_replicates_for_it_is_reached_soon(error: float, size: int) -> None:
    assert replicate_size_for(Settings(), Target(error=error)) == size
    assert replicate_size_for(Settings(), Target(error=error, spp=4)) == 1


@pytest.mark.parametrize("asked", [1, 2, 64])
def test_a_replicate_size_that_is_asked_for_is_taken(asked: int) -> None:
    assert replicate_size_for(Settings(replicate_size=asked), Target(spp=4)) == asked


def test_numbers_of_other_libraries_are_numbers() -> None:
    """`Target(spp=numpy.int64(16))` was refused: "it must be a whole number"."""
    limits: dict[str, Any] = {"spp": np.int64(16), "seconds": np.float32(0.5), "error": np.float64(0.1)}
    sides: dict[str, Any] = {"width": np.int32(8), "height": np.uint16(6)}
    target = Target(**limits)
    settings = Settings(**sides, **{"seed": np.uint64(3), "max_depth": np.int8(-1)})
    assert json.loads(json.dumps(target.as_dict() | settings.as_dict()))["spp"] == 16
    assert {type(value) for value in (target.spp, settings.width, settings.seed, settings.max_depth)} == {int}
    assert {type(value) for value in (target.seconds, target.error)} == {float}
    for bad in (np.float64(16), np.bool_(True), np.array([16])):
        with pytest.raises(SettingsError, match="whole number"):
            Target(spp=bad)  # type: ignore[arg-type]


def test_names_of_channels_in_one_text_are_no_list_of_letters() -> None:
    with pytest.raises(SettingsError, match=r"give a list of names: \['albedo', 'depth'\]"):
        Settings(channels="albedo,depth")  # type: ignore[arg-type]
