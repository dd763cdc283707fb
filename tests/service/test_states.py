"""The life of a job."""

from __future__ import annotations

import itertools

import pytest

from service.states import ENDED, TRANSITIONS, IllegalStep, State, Step, after, destination, sources


def test_a_job_runs_and_succeeds() -> None:
    assert after(after(State.QUEUED, Step.START), Step.FINISH) is State.SUCCEEDED


def test_every_step_not_in_the_table_is_refused() -> None:
    for state, step in itertools.product(State, Step):
        if (state, step) not in TRANSITIONS:
            with pytest.raises(IllegalStep, match=f"a job that is {state} cannot be"):
                after(state, step)


def test_every_step_leads_to_one_state_from_wherever_it_is_legal() -> None:
    for step in Step:
        assert {after(state, step) for state in sources(step)} == {destination(step)}


def test_an_ended_job_only_goes_on_by_being_continued() -> None:
    leaving = {(state, step) for state, step in TRANSITIONS if state in ENDED}
    assert leaving == {(state, Step.CONTINUE) for state in ENDED}


def test_every_state_can_be_reached_and_every_live_job_can_be_cancelled() -> None:
    assert {*TRANSITIONS.values()} == {*State}
    assert {*sources(Step.CANCEL)} == {*State} - ENDED
