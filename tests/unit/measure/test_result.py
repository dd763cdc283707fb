"""Facts about a measurement: times to targets, what is recommended, and what tables, JSON and chart say of it."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from renderer.measure.candidates import Candidate, candidates
from renderer.measure.chart import svg
from renderer.measure.result import TARGETS, Measurement, Point, Row
from renderer.measure.run import error_interval
from renderer.measure.table import percent, recommendations, say_seconds, settings_table
from renderer.settings import Settings


def curve(variance_time: float, until: float = 3.0) -> tuple[Point, ...]:
    """What an ideal Monte Carlo run with this constant shows."""
    points = []
    for seconds in np.geomspace(0.1, until, 9):
        error = math.sqrt(variance_time / seconds)
        points.append(Point(float(seconds), 100 * float(seconds), error, 0.9 * error, 1.1 * error))
    return tuple(points)


def row(name: str, variance_time: float, group: str = "technique", **more: object) -> Row:
    made = Row(Candidate(name, group, Settings()), curve(variance_time), 1_000_000, 3.0, 0.9, 0.99, 0)
    return replace(made, **more)


def measurement(*others: Row) -> Measurement:
    return Measurement("box", "ab" * 32, 64, 48, 3.0, (row("mis", 0.01, "default"), *others))


@given(st.floats(1e-7, 1e3), st.sampled_from(TARGETS))
def test_time_to_a_target_is_variance_time_over_its_square_measured_or_not(constant: float, target: float) -> None:
    found = row("x", constant).time_to(target)
    assert found is not None
    if constant / target**2 > 0.1:
        assert found.seconds == pytest.approx(constant / target**2, rel=1e-6)
    assert found.is_measured == (constant / target**2 <= 3.0 * (1 + 1e-9))


def test_efficiency_is_relative_to_the_default() -> None:
    found = measurement(row("bsdf", 0.04), row("emitter", 0.005))
    assert found.relative_efficiency(found.rows[1]) == pytest.approx(0.25)
    assert found.relative_efficiency(found.rows[2]) == pytest.approx(2)


def noisy_curve(rng: np.random.Generator, variance_time: float, spread: float, start: float) -> tuple[Point, ...]:
    """Work of each stretch off by so much, after seconds of start-up; errors are known to 1 %."""
    seconds = np.geomspace(0.05, 3.0, 20)
    work = np.cumsum(np.diff(seconds, prepend=0) / variance_time * np.exp(spread * rng.standard_normal(20)))
    errors = 1 / np.sqrt(work)
    return tuple(Point(s + start, 100 * s, e, 0.99 * e, 1.01 * e) for s, e in zip(seconds, errors, strict=True))


@pytest.mark.parametrize("truth", [1.0, 3.0])
def test_the_interval_of_a_ratio_holds_the_truth(truth: float) -> None:
    """At least 90 % of 300 for intervals of 95 %; fewer are seen once in 10,000 times."""
    rng = np.random.default_rng(5)
    held = said = 0
    for _ in range(300):
        of_default, of_other = (noisy_curve(rng, constant, 0.2, 0.3) for constant in (0.01, 0.01 / truth))
        found = measurement(row("emitter", 1.0, curve=of_other))
        found = replace(found, rows=(replace(found.default, curve=of_default), found.rows[1]))
        interval = found.efficiency_interval(found.rows[1])
        assert interval is not None
        held += interval[0] <= truth <= interval[1]
        said += "no difference seen" not in text_of(found)
    assert held >= 270
    assert said <= 30 if truth == 1 else said > 290


def test_no_ratio_is_said_without_an_interval_that_leaves_1_out() -> None:
    alike = measurement(row("bsdf", 0.0098))
    assert alike.efficiency_interval(alike.rows[1]) is not None
    assert "no difference seen" in text_of(alike)
    assert "1.02 ×" not in text_of(alike)
    clear = measurement(row("bsdf", 0.04))
    low, high = clear.efficiency_interval(clear.rows[1]) or (0, 0)
    assert low < 0.25 < high < 1
    assert f"0.25 × ({low:.2f}–{high:.2f})" in text_of(clear)
    short = row("bsdf", 0.04, curve=curve(0.04)[-3:])
    assert measurement(short).efficiency_interval(short) is None
    assert "0.25 ×" not in text_of(measurement(short))
    doubted = row("bsdf", 0.04, share_trusted=0.1, share_found=0.3)
    assert measurement(doubted).efficiency_interval(doubted) is None


def test_the_recommendation_is_the_setting_of_least_error() -> None:
    found = measurement(row("bsdf", 0.04), row("emitter", 0.005))
    best = found.recommended(60)
    assert best is not None
    assert best.name == "emitter"
    assert best.error_after(50) == pytest.approx(0.01)


def test_a_gain_too_small_to_be_sure_of_keeps_the_default() -> None:
    found = measurement(row("emitter", 0.0098))
    assert found.recommended(60) is found.default


def test_what_cannot_be_trusted_is_not_recommended() -> None:
    found = measurement(row("uniform", 1e-6, share_trusted=0.1, share_found=0.3))
    assert found.recommended(60) is found.default


def test_light_that_is_left_out_is_recommended_for_short_budgets_only_and_only_if_allowed() -> None:
    shallow = row("depth 2", 0.001, "depth", lost_light=0.1, lost_rel_mse=0.02**2)
    found = measurement(shallow)
    assert found.recommended(1.0) is found.default
    assert found.recommended(1.0, allow_lost_light=True) is shallow
    assert found.recommended(600.0, allow_lost_light=True) is found.default
    assert shallow.time_to(0.01) is None  # light left out: never
    assert "never" in text_of(found)


def test_nothing_found_is_said_and_not_divided_by() -> None:
    dark = row("uniform", 1.0, curve=(), share_found=0.0)
    found = measurement(dark)
    assert dark.efficiency == 0
    assert "no light found" in text_of(found)
    assert json.loads(json.dumps(found.as_dict()))["settings"][1]["error"] is None
    all_dark = Measurement("box", "ab", 8, 8, 1.0, (row("mis", 1.0, "default", curve=()), dark))
    assert all_dark.recommended(1.0) is None
    assert "None of the settings" in recommendations(all_dark)[0]
    assert "found any light" in svg(all_dark)
    json.dumps(all_dark.as_dict(), allow_nan=False)


def text_of(found: Measurement) -> str:
    console = Console(width=170, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(settings_table(found))
    return console.export_text()


def test_the_table_names_every_setting_and_marks_forecasts() -> None:
    text = text_of(measurement(row("bsdf", 0.04), row("uniform", 1e-4, share_trusted=0.2, share_found=0.3)))
    for expected in ("mis", "bsdf", "0.25 ×", "to 10 %", "~", "?"):
        assert expected in text


def test_json_holds_curves_times_and_recommendations() -> None:
    found = json.loads(json.dumps(measurement(row("bsdf", 0.04)).as_dict(), allow_nan=False))
    assert found["scene"] == "box"
    first = found["settings"][0]
    assert first["variance_time"] == pytest.approx(0.01)
    assert [t["target"] for t in first["time_to"]] == list(TARGETS)
    assert [t["measured"] for t in first["time_to"]] == [True, False, False, False]
    low, high = found["settings"][1]["relative_efficiency_interval"]
    assert low < found["settings"][1]["relative_efficiency"] < high
    assert first["relative_efficiency_interval"] is None
    assert {"seconds", "spp", "error", "low", "high", "true_error"} == set(first["curve"][0])
    assert found["recommended"][0]["name"] == "mis"


def test_the_chart_is_valid_svg_with_a_line_for_every_setting() -> None:
    names = ["bsdf", "a <b> & c", "uniform"]
    found = measurement(*(row(name, 0.02 * (i + 1)) for i, name in enumerate(names)))
    tree = ET.fromstring(svg(found))
    texts = " ".join(t.text or "" for t in tree.iter("{http://www.w3.org/2000/svg}text"))
    for name in ("mis", *names):
        assert name in texts
    titles = [t.text for t in tree.iter("{http://www.w3.org/2000/svg}title")]
    assert sorted(map(str, titles)) == sorted(["mis", *names])
    assert "nan" not in svg(found)
    assert "inf" not in svg(found).replace("infinite", "")


def test_labels_of_lines_that_end_together_do_not_overlap() -> None:
    found = measurement(*(row(f"n{i}", 0.01) for i in range(5)))
    tree = ET.fromstring(svg(found))
    ends = [
        float(t.attrib["y"])
        for t in tree.iter("{http://www.w3.org/2000/svg}text")
        if (t.text or "").startswith(("n0", "n1", "n2", "n3", "n4", "mis"))
    ]
    assert len(ends) == 6
    assert min(np.diff(sorted(ends))) >= 14.9


def test_the_interval_of_an_error_is_the_spread_over_pixels() -> None:
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(400):
        squared = rng.gamma(2.0, 0.5, 500)
        low, high = error_interval(squared)
        assert low < 1 < high
        covered += low <= 1 / math.sqrt(squared.mean()) <= high
    assert covered > 400 * 0.9


def test_candidates_differ_from_the_default_in_one_respect() -> None:
    found = candidates(Settings(seed=3, width=10, height=10), 12)
    base = found[0].settings
    assert len({c.name for c in found}) == len(found)
    for candidate in found[1:]:
        changed = [k for k, v in candidate.settings.as_dict().items() if v != base.as_dict()[k]]
        assert len(changed) == 1, candidate
    assert {c.group for c in found} >= {"default", "technique", "replicate size", "depth"}
    assert all((c.settings.max_depth or 0) < 12 for c in found if c.is_biased)


def test_techniques_only_are_the_techniques() -> None:
    found = candidates(Settings(), 12, techniques_only=True)
    assert {c.settings.technique for c in found} == {"mis", "bsdf", "emitter", "cosine", "uniform"}


@pytest.mark.parametrize(
    ("fraction", "said"), [(0.5, "50 %"), (0.0996, "10 %"), (0.0123, "1.2 %"), (0.00049, "0.049 %")]
)
def test_percentages_have_two_digits(fraction: float, said: str) -> None:
    assert percent(fraction) == said


@pytest.mark.parametrize(
    ("seconds", "said"), [(0.012, "12 ms"), (1.23, "1.2 s"), (42.4, "42 s"), (600, "10 min"), (7200, "2 h")]
)
def test_durations_are_short(seconds: float, said: str) -> None:
    assert say_seconds(seconds) == said
