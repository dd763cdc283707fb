"""Whose turn it is."""

from __future__ import annotations

import pytest

from service.dispatch import Candidate, next_job, seconds_left, seconds_until_start


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
