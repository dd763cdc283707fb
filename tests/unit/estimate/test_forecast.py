"""Facts about the forecast: an ideal curve is forecast exactly, and nothing is said too early."""

from __future__ import annotations

import math

import pytest

from renderer.estimate.forecast import EARLY, MAX_CAUTION, MIN_POINTS, OVERSHOOT, CurvePoint, forecast


def ideal(n: int, constant: float = 0.5) -> list[CurvePoint]:
    """error = constant / √t at n moments, late enough that nothing is unseen."""
    return [CurvePoint(t, 16e6 * t, e, e) for t in (1.3**i for i in range(n)) for e in [constant / math.sqrt(t)]]


def scaled(point: CurvePoint, factor: float) -> CurvePoint:
    """The same point with another error, which is its own bound."""
    return CurvePoint(point.seconds, point.spp, factor * point.error, factor * point.error)


@pytest.mark.parametrize("n", range(MIN_POINTS))
def test_nothing_is_forecast_from_too_few_points(n: int) -> None:
    assert forecast(ideal(n), 0.02) is None


@pytest.mark.parametrize("constant", [1e-3, 0.5, 40.0])
@pytest.mark.parametrize("n", [MIN_POINTS, 9, 30])
def test_a_curve_that_falls_with_the_root_of_time_is_forecast_exactly(n: int, constant: float) -> None:
    curve = ideal(n, constant)
    target = curve[-1].error / 3
    found = forecast(curve, target)
    assert found is not None
    assert found.seconds_left == pytest.approx((9 * OVERSHOOT - 1) * curve[-1].seconds, rel=1e-6)
    assert found.low < found.seconds_left < found.high


def test_a_target_that_is_met_is_no_time_away() -> None:
    curve = ideal(10)
    found = forecast(curve, 2 * curve[-1].error)
    assert found is not None
    assert (found.low, found.seconds_left, found.high) == (0, 0, 0)


def test_a_restless_curve_has_the_wider_interval() -> None:
    calm = ideal(12)
    restless = [scaled(p, 1.05 if i % 2 else 0.95) for i, p in enumerate(calm)]
    target = calm[-1].error / 4
    a, b = forecast(calm, target), forecast(restless, target)
    assert a is not None
    assert b is not None
    assert b.high - b.low > 1.5 * (a.high - a.low)


def test_the_beginning_of_the_curve_is_forgotten() -> None:
    late = ideal(12)
    odd_start = [scaled(p, 9.0) for p in late[:6]] + late[6:]
    assert forecast(odd_start, 0.01) == forecast(late, 0.01)


def test_points_without_an_error_are_passed_over() -> None:
    flat = [CurvePoint(float(t), float(t), 0.0, 0.0) for t in range(1, 9)]
    assert forecast(flat, 0.02) is None
    assert forecast([*flat[:4], *ideal(4)], 0.02) is not None


def test_a_curve_whose_constant_still_drifts_is_not_forecast() -> None:
    settled = ideal(12)
    drifting = [scaled(p, 1.1**i) for i, p in enumerate(settled)]
    assert forecast(settled, 0.01) is not None
    assert forecast(drifting, 0.01) is None


def bounded(caution: float, n: int = 12) -> list[CurvePoint]:
    """An ideal curve whose bound comes down to the error like 1/√samples; at its end it is `caution` times as large."""
    curve = ideal(n)
    excess = math.log(caution) * math.sqrt(curve[-1].spp)
    return [CurvePoint(p.seconds, p.spp, p.error, p.error * math.exp(excess / math.sqrt(p.spp))) for p in curve]


def test_nothing_is_forecast_before_every_pixel_has_a_variance() -> None:
    early = [CurvePoint(p.seconds, p.spp, p.error) for p in ideal(6)]
    assert forecast(early, 0.01) is None
    assert forecast([*early[:-1], *ideal(6)[-1:]], 0.01) is not None, "one bound is enough; the pace is known"


def test_what_is_not_seen_of_the_error_at_first_is_added() -> None:
    few = [CurvePoint(1.0, 16.0, 0.5), CurvePoint(2.0, 32.0, 0.4, 0.4)]
    found = forecast(few, 0.05)
    assert found is not None
    assert found.seconds_left > 1.02 * (OVERSHOOT * 64 * 32 - 32) / 16
    total = 64 * 32 * math.exp(2 * EARLY / 32 * (1 - 1 / 64))
    assert found.seconds_left == pytest.approx((OVERSHOOT * total - 32) / 16, rel=2e-3)


def test_the_farther_the_bound_from_the_error_the_wider_the_interval() -> None:
    near, far = forecast(bounded(1.05), 0.01), forecast(bounded(1.4), 0.01)
    assert near is not None
    assert far is not None
    assert far.high / far.seconds_left > 1.2 * near.high / near.seconds_left


@pytest.mark.parametrize("caution", [1.0, 1.1, 1.4])
def test_the_forecast_is_of_the_bound_that_stops_the_render(caution: float) -> None:
    curve = bounded(caution)
    last = curve[-1]
    times = 16.0  # as many samples as now
    target = last.error / math.sqrt(times) * caution ** (1 / math.sqrt(times))
    found = forecast(curve, target)
    assert found is not None
    assert found.seconds_left == pytest.approx((times * OVERSHOOT - 1) * last.seconds, rel=1e-6)


def test_nothing_is_forecast_while_the_tail_decides() -> None:
    assert forecast(bounded(MAX_CAUTION * 1.01), 0.01) is None


@pytest.mark.parametrize("target", [1e-6, 1e-3, 0.3, 10.0])
@pytest.mark.parametrize("upper", [1.0, 1.4, 1e3, 1e9])
def test_no_curve_is_too_odd(upper: float, target: float) -> None:
    curve = [CurvePoint(p.seconds, p.spp, p.error, upper * p.error) for p in ideal(6)]
    found = forecast([*curve[:-1], CurvePoint(9.0, 80.0, 0.2, 0.21)], target)
    assert found is None or 0 <= found.low <= found.seconds_left <= found.high < math.inf


def test_before_adaptive_rounds_begin_a_forecast_allows_for_what_they_save() -> None:
    curve = ideal(12)
    target = curve[-1].error / 4
    level, ahead = forecast(curve, target), forecast(curve, target, is_level_so_far=True)
    assert level is not None
    assert ahead is not None
    assert ahead.seconds_left < level.seconds_left < ahead.high
    assert ahead.low < 0.7 * level.seconds_left
