"""The render process as the server sees it: replaced whenever it is lost."""

from __future__ import annotations

import asyncio
import os
import signal
import time

import pytest
from service_process import is_alive

from renderer.settings import Settings
from service.engine.local import LocalEngine, Lost
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
