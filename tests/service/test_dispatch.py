"""Whose turn it is."""

from __future__ import annotations

from service.dispatch import Candidate, next_job


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
