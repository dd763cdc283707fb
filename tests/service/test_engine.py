"""The render process as the server sees it: replaced whenever it is lost."""

from __future__ import annotations

import asyncio
import errno
import os
import signal
import time
from pathlib import Path

import pytest
from service_process import is_alive

from renderer.settings import Settings
from service.engine.local import LocalEngine, Lost
from service.engine.reserve import Reserve
from service.engine.worker import kept_scene


def test_a_lost_process_is_told_and_replaced() -> None:
    async def scenario() -> None:
        engine = LocalEngine("test")
        try:
            first = await engine.submit(os.getpid, deadline=20)
            assert first == engine.pid
            with pytest.raises(Lost, match="died"):
                await engine.submit(os._exit, 3, deadline=20)
            second = await engine.submit(os.getpid, deadline=20)
            assert second != first

            with pytest.raises(Lost, match=r"no answer within 0\.2 s"):
                await engine.submit(time.sleep, 30, deadline=0.2)
            third = await engine.submit(os.getpid, deadline=20)
            assert third != second
            assert not is_alive(second)

            # One that dies while it has nothing to do is nobody's fault.
            os.kill(third, signal.SIGKILL)
            await asyncio.sleep(0.5)
            assert await engine.submit(abs, -4, deadline=20) == 4
        finally:
            engine.close()

    asyncio.run(scenario())


def test_what_a_call_raises_reaches_the_caller_and_the_process_lives() -> None:
    async def scenario() -> None:
        engine = LocalEngine("test")
        try:
            with pytest.raises(ValueError, match="invalid literal"):
                await engine.submit(int, "x", deadline=20)
            pid = engine.pid
            assert await engine.submit(os.getpid, deadline=20) == pid
        finally:
            engine.close()

    asyncio.run(scenario())


def test_a_kept_scene_is_that_of_the_colour_asked_for() -> None:
    """A job in another colour before it must not decide what a job without a wish gets."""
    seen = [kept_scene("furnace", Settings(16, 16, colour=name)) for name in ("spectral", "auto", "rgb", "auto")]
    assert [scene.colour for scene in seen] == ["spectral", "mono", "rgb", "mono"]
    assert seen[1].mitsuba_scene is seen[3].mitsuba_scene


def test_a_process_starts_on_full_shared_memory_with_what_was_kept_for_it(tmp_path: Path) -> None:
    reserve, taken = Reserve(tmp_path), []

    def needs_room() -> int:
        taken.append(reserve._held is None)
        if not taken[-1]:
            raise OSError(errno.ENOSPC, "No space left on device")
        return 7

    assert reserve.spending(needs_room) == 7
    assert taken == [False, True], "it is given back for the second try alone"
    assert reserve._held is not None, "and kept again for the next one"
    assert not list(tmp_path.iterdir()), "without a name: nothing stays where the server is killed"
    nowhere = Reserve(tmp_path / "none")
    with pytest.raises(OSError, match="No space"):
        nowhere.spending(lambda: (_ for _ in ()).throw(OSError(errno.ENOSPC, "No space left on device")))
    with pytest.raises(PermissionError):
        reserve.spending(lambda: (_ for _ in ()).throw(PermissionError()))
    assert reserve._held is not None


def test_a_render_process_works_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mitsuba looks for files where its process runs, too."""
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(tmp_path)

    async def listed() -> list[str]:
        engine = LocalEngine("test", tmp_path / "displays")
        try:
            return await engine.submit(os.listdir, ".", deadline=60)
        finally:
            engine.close()

    assert asyncio.run(listed()) == []
