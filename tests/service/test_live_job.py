"""What is known of a running job: of its picture on disk, and of what may be lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from service.engine.turn import TurnResult
from service.live import LiveJob
from service.shown import MOST_CHARACTERS
from service.states import State
from service.store import JobRecord, Kept, Progress
from service.store.records import now

RECORD = JobRecord(
    *(1, "id", "Box", "gallery", "cornell-box", "Box", State.RUNNING, {"spp": 64}, {"width": 4}),
    *(now(), now(), None, 1, 0, None, Progress(), None, None, ()),
)


def turn(spp: int, saved: int | None = None) -> TurnResult:
    def progress(spp: int) -> Progress:
        return Progress(error=1 / spp, spp=spp, samples=16 * spp, seconds=spp / 10, frame_seq=spp)

    curve = tuple({"seconds": n / 10, "spp": float(n), "error": 1 / n} for n in (spp - 1, spp))
    return TurnResult(progress(spp), curve, None if saved is None else Kept(f"id/{saved}.exr", None, progress(saved)))


def test_numbers_of_a_job_that_leaves_are_those_of_the_picture_that_stays() -> None:
    live = LiveJob.of(RECORD, Path("display"))
    live.absorb(turn(4))
    assert live.lasting() == Progress(), "no picture is on disk yet"
    live.absorb(turn(8, saved=4))
    kept = live.lasting()
    assert (live.checkpoint, kept.spp, kept.error) == ("id/4.exr", 4, 0.25)
    assert kept.frame_seq > live.progress.frame_seq, "news to those who saw the newer one"
    live.absorb(turn(12, saved=12))
    assert live.lasting() == live.progress
    later = LiveJob.of(replace(RECORD, progress=live.progress, checkpoint=live.checkpoint), Path("display"))
    assert later.lasting() == live.progress


def test_a_curve_goes_forward_also_where_a_crash_threw_the_job_back() -> None:
    live = LiveJob.of(RECORD, Path("display"))
    for spp in (4, 8, 12):
        live.absorb(turn(spp))
    live.absorb(turn(6))
    assert [point["spp"] for point in live.curve] == [3, 4, 5, 6]


def test_long_names_in_what_a_scene_warns_of_are_cut() -> None:
    live = LiveJob.of(RECORD, Path("display"))
    live.absorb(replace(turn(4), warnings=(f"{'x' * 100_000}: flat",)))
    assert [len(one) for one in live.record.warnings] == [MOST_CHARACTERS]


def test_the_estimate_before_the_newest_is_kept_while_a_job_runs() -> None:
    live = LiveJob.of(RECORD, Path("display"))
    for spp in (4, 8, 12):
        live.absorb(turn(spp, saved=spp))
    assert [kept.name for kept in live.kept] == ["id/12.exr", "id/8.exr"]
