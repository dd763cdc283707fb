"""The life of a job as one table. Pure: nothing here knows of databases or processes."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """Where a job is."""

    QUEUED = "queued"
    RUNNING = "running"
    PAUSED = "paused"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Step(StrEnum):
    """What happens to a job."""

    START = "start"
    GIVE_BACK = "give back"  # its server went away; it waits again, with its last saved estimate
    FINISH = "finish"
    FAIL = "fail"
    CANCEL = "cancel"
    PAUSE = "pause"
    RESUME = "resume"
    CONTINUE = "continue"


ENDED = frozenset({State.SUCCEEDED, State.FAILED, State.CANCELLED})

TRANSITIONS: dict[tuple[State, Step], State] = {
    (State.QUEUED, Step.START): State.RUNNING,
    (State.QUEUED, Step.CANCEL): State.CANCELLED,
    (State.QUEUED, Step.FAIL): State.FAILED,
    (State.QUEUED, Step.PAUSE): State.PAUSED,
    (State.RUNNING, Step.GIVE_BACK): State.QUEUED,
    (State.RUNNING, Step.FINISH): State.SUCCEEDED,
    (State.RUNNING, Step.FAIL): State.FAILED,
    (State.RUNNING, Step.CANCEL): State.CANCELLED,
    (State.RUNNING, Step.PAUSE): State.PAUSED,
    (State.PAUSED, Step.RESUME): State.QUEUED,
    (State.PAUSED, Step.CANCEL): State.CANCELLED,
    (State.SUCCEEDED, Step.CONTINUE): State.QUEUED,
    # Their estimates were kept, so they may go on too.
    (State.CANCELLED, Step.CONTINUE): State.QUEUED,
    (State.FAILED, Step.CONTINUE): State.QUEUED,
}

# A running job is cancelled first: then nothing writes to what is deleted.
DELETABLE = frozenset({*State} - {State.RUNNING})


_DONE_TO_IT = {
    Step.START: "started",
    Step.GIVE_BACK: "given back",
    Step.FINISH: "finished",
    Step.FAIL: "failed",
    Step.CANCEL: "cancelled",
    Step.PAUSE: "paused",
    Step.RESUME: "resumed",
    Step.CONTINUE: "continued",
}


class IllegalStep(Exception):
    """A job in this state cannot take this step."""

    def __init__(self, state: State, step: Step) -> None:
        self.state = state
        self.step = step
        needed = " or ".join(sources(step))
        super().__init__(f"a job that is {state} cannot be {_DONE_TO_IT[step]}; that needs one that is {needed}")


def after(state: State, step: Step) -> State:
    """The state that `step` leads to. Raises IllegalStep."""
    try:
        return TRANSITIONS[state, step]
    except KeyError:
        raise IllegalStep(state, step) from None


def sources(step: Step) -> tuple[State, ...]:
    """The states from which `step` is legal."""
    return tuple(state for state, taken in TRANSITIONS if taken is step)


def destination(step: Step) -> State:
    """The one state that `step` leads to, wherever it is legal."""
    (state,) = {to for (_, taken), to in TRANSITIONS.items() if taken is step}
    return state
