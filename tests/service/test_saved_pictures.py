"""Large finished pictures are read one after the other: each takes much memory while it is read."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from service import estimates, picture_room
from service.display import Display
from service.estimates import EstimateFiles
from service.frames import FrameCache
from service.picture_room import PictureRoom, SharedBody
from service.routes import frames
from service.store import Kept, Progress


def test_many_who_ask_for_finished_pictures_at_once_cost_the_memory_of_one() -> None:
    reading, most, lock = 0, 0, threading.Lock()

    def saved(*_: Any) -> None:
        nonlocal reading, most
        with lock:
            reading += 1
            most = max(most, reading)
        time.sleep(0.05)
        with lock:
            reading -= 1

    async def all_at_once() -> None:
        service: Any = SimpleNamespace(
            frames=FrameCache(), files=SimpleNamespace(saved=saved), picture_room=PictureRoom()
        )
        size = {"width": 1024, "height": 1024}
        jobs: list[Any] = [
            SimpleNamespace(
                id=str(i), client_id="", settings=size, checkpoint=name, kept=(Kept(name, None, Progress()),)
            )
            for i, name in enumerate(f"{i}/1.exr" for i in range(5))
        ]
        await asyncio.gather(*(frames._saved(service, job) for job in jobs))

    asyncio.run(all_at_once())
    assert most == 1


@pytest.mark.parametrize("is_full", [False, True], ids=["", "full disk"])
def test_saved_pictures_that_were_just_read_need_not_be_read_again(
    is_full: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They lie in files without a name, which take no memory that the system could not have back."""
    files = EstimateFiles(tmp_path / "estimates", SimpleNamespace())  # type: ignore[arg-type]
    files.prepare()
    size, read = (64, 48), []

    def picture(name: str, seq: int, seconds: float) -> Display:
        read.append(name)
        values = np.full(size, float(name), np.float32)
        errors = np.repeat(values[..., None], 4, axis=2)
        return Display(seq, 4, seconds, errors[..., :3], errors, values.astype(np.uint32), values > 1)

    monkeypatch.setattr(files, "check", lambda kept: None)
    monkeypatch.setattr(files, "_read", picture)
    if is_full:
        monkeypatch.setattr(estimates, "_LEFT_ON_DISK_BYTES", 1 << 62)
    kept = [Kept(str(i), None, Progress(frame_seq=i, seconds=0.5)) for i in range(4)]
    for _ in range(2):
        for i, one in enumerate(kept):
            shown = files.saved(one)
            assert (shown.seq, shown.seconds, shown.radiance.shape) == (i, 0.5, (*size, 3))
            assert (shown.radiance == i).all()
            assert (shown.standard_error == i).all()
            assert (shown.trusted == (i > 1)).all()
            assert not list((tmp_path / "sending").iterdir()), "nothing is left where the process is killed"
    assert len(read) == (8 if is_full else 4), "without room on disk the latest alone is kept, in memory"
    monkeypatch.setattr(estimates, "_SHOWN_BYTES", 1)
    files.saved(Kept("7", None, Progress(frame_seq=7)))
    assert len(files._shown) == 1
    files.remove_displays()


def test_all_work_on_pictures_has_its_room_and_a_frame_is_encoded_once_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    told: list[tuple[str, int]] = []

    class Told(PictureRoom):
        @asynccontextmanager
        async def taking(self, size: int, client: str = "") -> AsyncIterator[None]:
            told.append((client, size))
            async with super().taking(size, client):
                yield

    def encode(*_: Any, **__: Any) -> bytes:
        made.append("frame")
        time.sleep(0.05)
        return b"frame"

    size = (24, 32)
    values = np.ones(size, np.float32)
    errors = np.repeat(values[..., None], 4, axis=2)
    shown = Display(1, 4, 0.5, errors[..., :3], errors, values.astype(np.uint32), values > 0)
    live = SimpleNamespace(display_path=tmp_path / "shown")
    files = SimpleNamespace(shown=lambda _: shown, path=lambda name: tmp_path / name, hold=lambda _: tmp_path / "held")
    service: Any = SimpleNamespace(
        frames=FrameCache(), picture_room=Told(), files=files, runner=SimpleNamespace(live=lambda _: live)
    )
    kept = (Kept("j/1.exr", None, Progress()),)
    settings, names = {"width": 32, "height": 24}, {"name": "a", "scene_kind": "upload", "scene_ref": "a"}
    job: Any = SimpleNamespace(
        id="j",
        client_id="alice",
        settings=settings,
        state="running",
        checkpoint=None,
        kept=kept,
        progress=Progress(frame_seq=1),
        **names,
    )
    monkeypatch.setattr(frames.frames, "encode_frame", encode)
    monkeypatch.setattr(frames, "_write_picture", lambda *_: made.append("exr"))

    async def asked() -> set[bytes]:
        bodies = await asyncio.gather(
            *(frames._frame_body(service, job, shown, 1, False, "identity") for _ in range(5))
        )
        request: Any = SimpleNamespace(headers={})
        sent = [await frames.image_png(job, request, service, 0.0, "srgb")]
        sent.append(await frames.latest_frame(job, service, 0, "1", "0", "identity", ""))
        assert all(isinstance(answer, SharedBody) for answer in sent), "who reads slowly keeps a part"
        job.checkpoint = "j/1.exr"
        await frames.image_exr(job, service, "0")
        return set(bodies)

    assert asyncio.run(asked()) == {b"frame"}
    assert made == ["frame", "exr"]
    per_pixel = (picture_room.ENCODE_BYTES, picture_room.PNG_BYTES, picture_room.READ_BYTES)
    assert told == [("alice", 24 * 32 * one) for one in per_pixel]


def test_what_is_shown_lies_in_shared_memory_where_there_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared, other = tmp_path / "shared", tmp_path / "other"
    shared.mkdir()
    monkeypatch.setattr(estimates, "_SHARED_MEMORY", shared)
    for free, folder in ((64 << 20, other), (2 << 30, shared)):  # as containers have it, as machines have it
        monkeypatch.setattr(estimates.shutil, "disk_usage", lambda _, free=free: SimpleNamespace(free=free))
        assert estimates._fast_folder(other) == folder
