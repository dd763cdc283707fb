"""Whose turn it is."""

from __future__ import annotations

from dataclasses import replace

import pytest

from service.dispatch import (
    PREVIEW_CREDIT,
    Candidate,
    Shares,
    Waiting,
    may_start,
    next_job,
    seconds_left,
    seconds_until_start,
    start_order,
)


def test_nobody_is_next_when_nothing_runs() -> None:
    assert next_job([]) is None


def test_a_first_picture_goes_before_refinement() -> None:
    old = Candidate("old", number=1, has_picture=True, last_turn=1)
    new = Candidate("new", number=2, has_picture=False, last_turn=0)
    assert next_job([old, new]) == "new"


def test_jobs_with_pictures_take_turns() -> None:
    last = {"a": 1, "b": 2, "c": 3}
    order: list[str] = []
    for turn in range(4, 10):
        chosen = next_job(Candidate(name, i, True, last[name]) for i, name in enumerate(last))
        assert chosen is not None
        last[chosen] = turn
        order.append(chosen)
    assert order == ["a", "b", "c", "a", "b", "c"]


def test_of_two_new_jobs_the_older_is_first() -> None:
    assert next_job([Candidate("b", 2, False, 0), Candidate("a", 1, False, 0)]) == "a"


@pytest.mark.parametrize(
    ("position", "remaining", "expected"),
    [
        (1, [5.0, 9.0], 0.0),  # a free slot
        (2, [5.0, 9.0], 15.0),  # the first of three equal shares to end
        (3, [5.0, 9.0], 27.0),
        (4, [5.0, 9.0], None),  # two cannot make room for three
        (1, [None, None, 4.0], 12.0),
        (2, [None, None, 4.0], None),
    ],
)
def test_the_start_is_told_from_what_the_running_jobs_still_need(
    position: int, remaining: list[float | None], expected: float | None
) -> None:
    assert seconds_until_start(position, remaining, slots=3) == expected


def test_what_a_job_needs_is_its_nearest_limit() -> None:
    target = {"error": 0.01, "seconds": 100.0, "spp": 400}
    assert seconds_left(target, 10.0, 100.0, 60.0) == 30.0
    assert seconds_left(target, 10.0, 40.0, 60.0) == 60.0
    assert seconds_left(target, 10.0, 0.0, None) == 90.0
    assert seconds_left({"error": 0.01}, 10.0, 40.0, None) is None
    assert seconds_left({"seconds": 5.0}, 10.0, 40.0, None) == 0.0


def shares(**used: float) -> Shares:
    made = Shares()
    for client, seconds in used.items():
        made.charge(client, seconds)
    return made


def test_clients_get_equal_time_however_many_jobs_they_have() -> None:
    jobs = [Candidate(f"a{i}", i, True, 0, "a") for i in range(9)] + [Candidate("b", 99, True, 0, "b")]
    had, last = Shares(), dict.fromkeys([job.job_id for job in jobs], 0)
    for turn in range(1, 101):
        chosen = next_job([replace(job, last_turn=last[job.job_id]) for job in jobs], had)
        assert chosen is not None
        last[chosen] = turn
        had.charge(chosen[0], 0.3)
    assert had.of("a") == pytest.approx(had.of("b"), abs=0.31)
    assert min(last.values()) > 0, "each of the nine had a turn"


def test_priority_decides_within_a_client_and_not_between_clients() -> None:
    low, high = Candidate("low", 1, True, 1, "a"), Candidate("high", 2, True, 2, "a", priority=5)
    other = Candidate("other", 3, True, 3, "b")
    assert next_job([low, high, other], shares(a=1, b=2)) == "high"
    assert next_job([low, high, other], shares(a=2, b=1)) == "other"


def test_a_flood_of_new_jobs_from_one_client_does_not_stop_the_others() -> None:
    flood = [Candidate(f"a{i}", i, False, 0, "a") for i in range(100)]
    other = Candidate("other", 200, True, 0, "b")
    assert next_job([*flood, other], shares(a=PREVIEW_CREDIT)) == "a0"
    assert next_job([*flood, other], shares(a=PREVIEW_CREDIT + 0.1)) == "other"


def test_of_new_jobs_the_one_whose_scene_is_loaded_is_first() -> None:
    cold, warm = Candidate("cold", 1, False, 0), Candidate("warm", 2, False, 0, is_loaded=True)
    assert next_job([cold, warm]) == "warm"


def test_who_comes_back_does_not_make_up_for_the_time_away() -> None:
    had = shares(a=100.0, b=103.0)
    had.enter("new", ["a", "b"])
    assert had.of("new") == 100.0
    had.enter("alone", [])
    assert had.of("alone") == 0.0


def test_queued_jobs_start_client_by_client_and_by_priority_within_one() -> None:
    queued = [
        Waiting("a1", 1, False, "a"),
        Waiting("a2", 2, False, "a", priority=1),
        Waiting("a3", 3, True, "a", priority=9),
        Waiting("b1", 4, False, "b"),
    ]
    assert start_order(queued, {}) == ["a2", "b1", "a1", "a3"]
    assert start_order(queued, {"a": 2}) == ["b1", "a2", "a1", "a3"]
    assert start_order([], {"a": 2}) == []


def test_a_client_without_a_running_job_need_not_wait_for_a_slot() -> None:
    assert may_start("a", {"a": 1}, slots=2)
    assert not may_start("a", {"a": 2}, slots=2)
    assert may_start("b", {"a": 2}, slots=2)


def test_a_job_that_has_had_less_of_the_renderer_goes_first() -> None:
    slow, quick = Candidate("slow", 1, True, 1, seconds=10.0), Candidate("quick", 2, True, 2, seconds=9.0)
    assert next_job([slow, quick]) == "quick"


def test_a_first_picture_that_does_not_come_waits_like_any_other() -> None:
    old = Candidate("old", 1, True, 5, seconds=1.0)
    assert next_job([old, Candidate("new", 2, False, 6, seconds=1.0)]) == "new"
    assert next_job([old, Candidate("new", 2, False, 6, seconds=1.1 + PREVIEW_CREDIT)]) == "old"
