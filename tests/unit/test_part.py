"""Facts about parts of a render: merged in any order they are the straight render, bit for bit; what is odd is said."""

from __future__ import annotations

import itertools
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer import Estimate, Region, Settings, Target, load_scene, merge, passes, plan, render
from renderer.errors import CheckpointError, MergeError, SettingsError
from renderer.estimate.moments import Moments
from renderer.part import part_steps
from renderer.replay import replay

SETTINGS = Settings(width=24, height=16, seed=7, replicate_size=2)


def assert_same_bits(a: Moments, b: Moments) -> None:
    for field in fields(Moments):
        assert getattr(a, field.name).tobytes() == getattr(b, field.name).tobytes(), field.name


def straight(scene: Any, n_replicates: int, settings: Settings) -> Estimate:
    size = settings.replicate_size
    assert size is not None
    return render(scene, Target(spp=n_replicates * size), replace(settings, adaptive=False))


@pytest.mark.parametrize(
    ("scene", "other"),
    [
        ("cornell-box", {}),
        ("cornell-box", {"independent_pixels": True}),
        ("cornell-box", {"replicate_size": 1, "width": 13, "height": 5}),
        ("glass-sky", {"replicate_size": 64, "colour": "spectral"}),
        ("furnace", {"replicate_size": 16, "independent_pixels": True}),
        ("many-lights", {"technique": "emitter", "max_depth": 2}),
        ("cornell-box", {"guide": "on"}),
    ],
    ids=["shared samples", "independent pixels", "odd size", "spectral", "mono", "emitter", "guide"],
)
def test_parts_merge_in_any_order_to_the_bits_of_a_straight_render(scene: str, other: dict[str, Any]) -> None:
    settings = replace(SETTINGS, **other)
    loaded = load_scene(scene, settings=settings)
    whole = straight(loaded, 11, settings)
    cuts = (0, 3, 4, 9, 11)
    parts = [passes(loaded, range(a, b), settings) for a, b in itertools.pairwise(cuts)]
    for order in itertools.islice(itertools.permutations(parts), 0, None, 5):
        merged = merge(*order)
        assert_same_bits(merged.moments, whole.moments)
        one_by_one = order[0]
        for part in order[1:]:
            one_by_one = merge(one_by_one, part)
        assert_same_bits(one_by_one.moments, whole.moments)
    merged = merge(*parts)
    assert merged.held is None
    assert (merged.identity, merged.ranges) == (whole.identity, whole.ranges)
    assert merged.samples == sum(part.samples for part in parts)


@pytest.mark.parametrize("is_apart", [False, True], ids=["shared samples", "independent pixels"])
def test_regions_and_small_launches_change_no_bit(monkeypatch: pytest.MonkeyPatch, is_apart: bool) -> None:
    settings = replace(SETTINGS, independent_pixels=is_apart)
    loaded = load_scene("cornell-box", settings=settings)
    whole = straight(loaded, 6, settings)
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 300)  # some launches for each replicate
    mask = np.zeros((16, 24), bool)
    mask[3:7, 2:20:3] = True
    mask[8, 1] = True
    parts = [
        passes(loaded, range(0, 4), settings, region=mask),
        passes(loaded, range(4, 6), settings, region=Region.of(mask)),
        passes(loaded, range(0, 1), settings, region=~mask),
        passes(loaded, range(1, 6), settings, region=~mask),
    ]
    for order in (parts, parts[::-1], [parts[2], parts[1], parts[3], parts[0]]):
        assert_same_bits(merge(*order).moments, whole.moments)
    crop = passes(loaded, range(2), settings, region=[5, 4, 3, 2])
    assert set(np.flatnonzero(crop.moments.tried)) == {y * 24 + x for y in (4, 5) for x in (5, 6, 7)}


def test_a_part_is_an_estimate_of_its_own() -> None:
    part = passes("cornell-box", range(5, 8), SETTINGS)
    assert (part.spp, part.samples) == (6, 6 * 24 * 16)
    again = replay("cornell-box", SETTINGS, (11, 9), range(5, 8))
    assert part.pixel(11, 9).replicates == 3
    assert_same_bits(part.moments.at(slice(9 * 24 + 11, 9 * 24 + 12)), again.moments)
    assert part.held is not None
    assert part.held.said_missing == "0:5"


def test_a_straight_render_goes_on_by_parts_and_parts_go_on_by_a_render(tmp_path: Path) -> None:
    whole = straight("cornell-box", 8, SETTINGS)
    merged = merge(passes("cornell-box", range(3, 5), SETTINGS), straight("cornell-box", 3, SETTINGS))
    merged.write(tmp_path / "merged.exr")
    assert_same_bits(merged.moments, straight("cornell-box", 5, SETTINGS).moments)
    even = replace(SETTINGS, adaptive=False)
    resumed = render("cornell-box", Target(spp=16), even, start=Estimate.read(tmp_path / "merged.exr"))
    assert_same_bits(resumed.moments, whole.moments)


def test_a_part_that_waits_is_not_gone_on_from() -> None:
    part = passes("cornell-box", range(3, 5), SETTINGS)
    with pytest.raises(CheckpointError, match=r"waits for replicates 0:3; merge"):
        render("cornell-box", Target(spp=32), replace(SETTINGS, adaptive=False), start=part)


def test_parts_of_several_seeds_merge_seed_by_seed() -> None:
    parts = [passes("furnace", range(a, b), replace(SETTINGS, seed=s)) for s in (1, 2) for a, b in ((0, 2), (2, 5))]
    merged = [merge(*order) for order in itertools.permutations(parts)]
    assert merged[0].ranges == ((1, 5), (2, 5))
    for other in merged[1:]:
        assert_same_bits(merged[0].moments, other.moments)
    with pytest.raises(MergeError, match=r"seed 2 waits for its replicates 0:2; merge all of its parts"):
        merge(parts[0], parts[1], parts[3])


def test_parts_that_cannot_be_of_one_render_are_refused_by_name() -> None:
    a, b = (passes("furnace", range(first, first + 2), SETTINGS) for first in (0, 2))
    with pytest.raises(MergeError, match=r"overlap: both hold seed 7, both hold replicates 1:2 of 384 pixels"):
        merge(a, passes("furnace", range(1, 3), SETTINGS))
    for other, said in (
        ({"max_depth": 3}, "settings differ: max_depth"),
        ({"replicate_size": 4}, "replicate sizes differ: 2 and 4"),
        ({"independent_pixels": True}, "settings differ: independent_pixels"),
        ({"width": 12}, "image sizes differ"),
    ):
        asked = replace(SETTINGS, **({"height": 16} | other))
        if other.get("independent_pixels") and a.identity.setting("independent_pixels"):
            continue
        with pytest.raises(MergeError, match=said):
            merge(a, passes("furnace", range(2, 4), asked))
    with pytest.raises(MergeError, match="scenes differ"):
        merge(a, passes("cornell-box", range(2, 4), replace(SETTINGS, colour=a.identity.settings["colour"])))
    older = replace(b, identity=replace(b.identity, made_with=("fredholm 0.0.1",)))
    with pytest.raises(MergeError, match=r"seed 7.*made by fredholm .* and by fredholm 0\.0\.1.*have the bits of none"):
        merge(a, older)


@pytest.mark.parametrize(
    ("replicates", "said"),
    [
        (range(3, 3), "replicates are 3:3"),
        (range(-1, 3), "replicates are -1:3"),
        (range(0, 8, 2), "give a range"),
        (5, "give a range"),
        (range(0, 2**31), "at most 2147483647"),
        (range(1, 2**30), r"take .* GiB, and 8 GiB is the most; render fewer in one part"),
    ],
)
def test_ranges_that_cannot_be_are_refused(replicates: Any, said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        passes("furnace", replicates, SETTINGS)


@pytest.mark.parametrize("first", [0, 5])
def test_a_stop_keeps_the_replicates_that_all_pixels_have(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    monkeypatch.setattr(plan, "pass_samples_for", lambda *_: 300)
    asked, steps = range(first, first + 6), itertools.count()
    told = list(part_steps("cornell-box", asked, SETTINGS, should_stop=lambda: next(steps) >= 9))
    last = told[-1]
    assert last.is_last
    assert first < last.done.stop < asked.stop
    assert last.estimate is not None
    assert [t.share for t in told] == sorted(t.share for t in told)
    assert (last.estimate.moments.tried == len(last.done)).all()
    rest = passes("cornell-box", range(last.done.stop, asked.stop), SETTINGS)
    before = [passes("cornell-box", range(first), SETTINGS)] if first else []
    assert_same_bits(merge(rest, last.estimate, *before).moments, straight("cornell-box", asked.stop, SETTINGS).moments)
    at_once = list(part_steps("cornell-box", asked, SETTINGS, should_stop=lambda: True))[-1]
    assert (at_once.done, at_once.estimate) == (range(first, first), None)
