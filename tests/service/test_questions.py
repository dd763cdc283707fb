"""What clients ask beside their jobs has turns as a job has."""

from __future__ import annotations

import asyncio

import pytest

from service.dispatch import Candidate, Shares, next_job
from service.questions import MOST_OF_ONE_CLIENT, MOST_QUESTIONS, Busy, Question, Questions


def share_of_turns(jobs: list[Candidate], asker: str, turns: int = 400) -> dict[str, float]:
    """Share of the renderer's time that each job has while a client asks without end; every turn takes a second."""

    async def whole() -> dict[str, float]:
        questions, shares = Questions(), Shares()
        seconds = {job.job_id: 0.0 for job in jobs}
        for turn in range(1, turns + 1):
            question = Question(asker, 1.0, int, (), asyncio.get_running_loop().create_future())
            questions.add(question, min(seconds[job.job_id] for job in jobs if job.client_id == asker))
            candidates = [
                Candidate(j.job_id, j.number, True, 0, j.client_id, j.priority, True, seconds[j.job_id]) for j in jobs
            ]
            chosen = next_job([*candidates, *questions.candidates({})], shares)
            assert chosen is not None
            if (taken := questions.take(chosen, turn)) is not None:
                questions.charge(taken.client_id, 1.0)
                shares.charge(taken.client_id, 1.0)
            else:
                seconds[chosen] += 1
                shares.charge(next(j.client_id for j in jobs if j.job_id == chosen), 1.0)
                question.answer.cancel()
        return {name: had / turns for name, had in seconds.items()}

    return asyncio.run(whole())


def test_a_flood_of_questions_leaves_the_jobs_of_others_their_share() -> None:
    mine, theirs = Candidate("mine", 1, True, 0, "asker"), Candidate("theirs", 2, True, 0, "other")
    shares = share_of_turns([mine, theirs], "asker")
    assert shares["theirs"] >= 0.48
    assert shares["mine"] >= 0.22, "its own job is one of two that its client has"


def test_a_flood_of_questions_is_one_job_among_those_of_its_client() -> None:
    jobs = [Candidate(name, i, True, 0) for i, name in enumerate("abc")]
    assert min(share_of_turns(jobs, "").values()) >= 0.23


def test_there_is_an_end_to_what_one_client_may_ask_at_once() -> None:
    async def flood() -> None:
        questions = Questions()
        futures = [asyncio.get_running_loop().create_future() for _ in range(MOST_OF_ONE_CLIENT + 1)]
        for future in futures[:-1]:
            questions.add(Question("a", 1.0, int, (), future), 0.0)
        with pytest.raises(Busy):
            questions.add(Question("a", 1.0, int, (), futures[-1]), 0.0)
        questions.add(Question("b", 1.0, int, (), asyncio.get_running_loop().create_future()), 0.0)
        futures[0].cancel()  # its client has gone
        questions.add(Question("a", 1.0, int, (), futures[-1]), 0.0)

    asyncio.run(flood())


def test_there_is_an_end_to_what_all_may_ask_at_once() -> None:
    async def flood() -> None:
        questions, loop = Questions(), asyncio.get_running_loop()
        for i in range(MOST_QUESTIONS):
            questions.add(Question(f"{i}", 1.0, int, (), loop.create_future()), 0.0)
        with pytest.raises(Busy):
            questions.add(Question("one more", 1.0, int, (), loop.create_future()), 0.0)

    asyncio.run(flood())
