"""Work on pictures has bounded memory, and who reads slowly keeps little of it."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest
from test_frames import display, noise

from service import frames, picture_room
from service.picture_room import PictureRoom, SharedBody


def test_work_waits_in_line_for_room_and_the_largest_is_alone() -> None:
    async def work() -> list[str]:
        room, began, ends = PictureRoom(10, 9), [], {name: asyncio.Event() for name in "abcd"}

        async def one(name: str, size: int) -> None:
            async with room.taking(size):
                began.append(name)
                await ends[name].wait()

        tasks = [asyncio.create_task(one(name, size)) for name, size in (("a", 6), ("b", 99), ("c", 3), ("d", 3))]
        await asyncio.sleep(0.01)
        assert began == ["a"], "b needs all of it, and c does not go before b"
        tasks[1].cancel()
        await asyncio.sleep(0.01)
        assert began == ["a", "c"]
        ends["a"].set()
        await asyncio.sleep(0.01)
        assert began == ["a", "c", "d"]
        for end in ends.values():
            end.set()
        await asyncio.gather(*tasks, return_exceptions=True)
        assert room.free == 10
        return began

    asyncio.run(work())


def test_a_client_with_many_pictures_waits_behind_itself_alone() -> None:
    async def work() -> list[str]:
        room, began, going_on = PictureRoom(1 << 30, 1), [], asyncio.Event()

        async def one(name: str, size: int, client: str) -> None:
            async with room.taking(size, client):
                began.append(name)
                await going_on.wait()

        large = picture_room._SHORT_BYTES + 1
        tasks = [asyncio.create_task(one(f"many {i}", large, "many")) for i in range(4)]
        tasks += [asyncio.create_task(one("large", large, "one")), asyncio.create_task(one("small", 100, "two"))]
        await asyncio.sleep(0.01)
        assert began == ["many 0", "small"], "a processor is left to whoever renders, and what is short goes on"
        going_on.set()
        await asyncio.gather(*tasks)
        return began[2:]

    assert asyncio.run(work()) == ["many 1", "large", "many 2", "many 3"]


def test_a_body_goes_out_in_parts_and_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    body, sent = bytes(range(256)) * 1024, []

    async def receive() -> Any:
        raise AssertionError("nothing is to be read")

    async def takes(message: Any) -> None:
        sent.append(message)

    async def takes_nothing(message: Any) -> None:
        if message["type"] == "http.response.body":
            await asyncio.Event().wait()

    asyncio.run(SharedBody(body)({}, receive, takes))
    parts = [message.get("body", b"") for message in sent[1:]]
    assert b"".join(parts) == body
    assert max(map(len, parts)) < len(body)
    assert [message.get("more_body") for message in sent[-2:]] == [True, False]
    monkeypatch.setattr(picture_room, "_SEND_SECONDS", 0.01)
    monkeypatch.setattr(picture_room, "_SEND_RATE", 1e9)
    begun: list[Any] = []

    async def takes_the_head(message: Any) -> None:
        begun.append(message)
        await takes_nothing(message)

    asyncio.run(asyncio.wait_for(SharedBody(body)({}, receive, takes_the_head), 20))
    assert [message["type"] for message in begun] == ["http.response.start", "http.response.body"], "and no end"


@pytest.mark.parametrize(("height", "width"), [(1, 1), (63, 5), (64, 7), (129, 4), (200, 3)])
@pytest.mark.parametrize("reduce", [1, 2])
def test_bands_change_no_bit_of_a_frame(height: int, width: int, reduce: int, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = display(noise(height, width), np.abs(noise(height, width)[..., 0]))
    banded = frames.encode_frame(shown, 2 if reduce == 2 else 1, has_maps=True)
    monkeypatch.setattr(frames, "_BAND", 1 << 20)
    assert banded == frames.encode_frame(shown, 2 if reduce == 2 else 1, has_maps=True)
