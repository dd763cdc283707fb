"""What clients ask the renderer beside their jobs: questions have turns as jobs have, and their time is charged."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from service.dispatch import Candidate

MOST_QUESTIONS, MOST_OF_ONE_CLIENT = 32, 8
_MARK = "?"  # in front of a client's id: no job's id begins with it


class Busy(Exception):
    """Too many ask the renderer beside its jobs, or this one has waited for too long."""


@dataclass(slots=True)
class Question:
    """A call whose value somebody waits for."""

    client_id: str
    seconds: float
    call: Callable[..., Any]
    args: tuple[object, ...]
    answer: asyncio.Future[Any]


@dataclass(slots=True)
class _Asker:
    """A client that asks. seconds: of the renderer that its questions have had, as of a job of its own."""

    waiting: deque[Question] = field(default_factory=deque)
    seconds: float = 0.0
    last_turn: int = 0


class Questions:
    """Those that wait, by client."""

    def __init__(self) -> None:
        self._askers: dict[str, _Asker] = {}

    def add(self, question: Question, job_seconds: float) -> None:
        """Let a question wait. job_seconds: that the client's jobs have had at least: what it asks comes in beside them
        like one more job. Raises Busy."""
        asker = self._askers.setdefault(question.client_id, _Asker())
        self._forget_given_up(asker)
        count = sum(len(one.waiting) for one in self._askers.values())
        if count >= MOST_QUESTIONS or len(asker.waiting) >= MOST_OF_ONE_CLIENT:
            raise Busy
        if not asker.waiting:
            asker.seconds = max(asker.seconds, job_seconds)
        asker.waiting.append(question)

    def candidates(self, priorities: Mapping[str, int]) -> Iterator[Candidate]:
        """Each client's questions as the dispatcher sees them. priorities: the highest among each client's jobs."""
        for client_id, asker in self._askers.items():
            self._forget_given_up(asker)
            if asker.waiting:
                priority, seconds = priorities.get(client_id, 0), asker.seconds
                # Somebody waits for the answer, as for a first picture.
                yield Candidate(
                    _MARK + client_id, 0, False, asker.last_turn, client_id, priority, is_loaded=True, seconds=seconds
                )

    def take(self, candidate_id: str, turn: int) -> Question | None:
        """The question that has the turn; None if it is a job's."""
        if not candidate_id.startswith(_MARK):
            return None
        asker = self._askers[candidate_id.removeprefix(_MARK)]
        asker.last_turn = turn
        return asker.waiting.popleft()

    def charge(self, client_id: str, seconds: float) -> None:
        """A question of a client has taken so long."""
        self._askers[client_id].seconds += seconds

    def clients(self) -> set[str]:
        """Who asks now."""
        return {client_id for client_id, asker in self._askers.items() if asker.waiting}

    @staticmethod
    def _forget_given_up(asker: _Asker) -> None:
        """Nobody waits for those any more: their connections are gone, or their time is over."""
        if any(question.answer.done() for question in asker.waiting):
            asker.waiting = deque(question for question in asker.waiting if not question.answer.done())
