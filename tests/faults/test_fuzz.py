"""Mutated uploads: whatever is sent, the service answers with a clear problem and reads no file outside the bundle.

Canaries, files that could be read, lie wherever Mitsuba or a plugin might look. None is opened; and an input that names
one gets the answer that it gets for a name that nothing has, word by word: so nothing of it shows.

200 mutations here with fixed seeds; `make fuzz` sends 20,000 others (FREDHOLM_FUZZ_COUNT, FREDHOLM_FUZZ_SEED).
"""

from __future__ import annotations

import io
import os
import sys
import time
import zipfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest

from tests.faults.canary import MARK, NUMBER, Canary
from tests.faults.conftest import Place
from tests.faults.mutate import Input, mutated
from tests.faults.seeds import SKY, bundle, scene

NAME, NOBODYS = "canary", "canarz"  # of files that are there, and of none: of one length
_SHOWN = (MARK, NUMBER, NUMBER[:6])


def content_of(file_name: str, content: bytes) -> object:
    """What of an input does not depend on how it is packed."""
    if not file_name.endswith(".zip"):
        return content
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return {entry.filename: archive.read(entry) for entry in archive.infolist()}
    except Exception:
        return content


def is_twin(one: Input, other: Input) -> bool:
    """Whether two inputs differ in the names of canaries alone, and do differ."""
    first, second = (repr(content_of(*each)) for each in (one, other))
    return first != second and first.replace(NAME, NOBODYS) == second


class Attack:
    """Sends mutated inputs and judges the answers."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.seen: Counter[str] = Counter()
        self.slowest = (0.0, 0)
        self.seconds: dict[str, list[float]] = {NAME: [], NOBODYS: []}  # of answers to twins
        self._clients = [
            httpx.Client(base_url=place.server.url, timeout=120, headers={"Authorization": f"Bearer {key}"})
            for key in place.keys
        ]

    def send(self, client: httpx.Client, seed: int, name: str, content: bytes) -> tuple[int, dict[str, Any], float]:
        began = time.perf_counter()
        answer = client.post("/api/scenes", files={"file": (name, content)})
        took = time.perf_counter() - began
        process = self.place.server.process
        assert process is not None
        assert process.poll() is None, seed
        assert answer.status_code in (200, 201, 413, 422), (seed, answer.status_code, answer.text)
        told = answer.json()
        for shown in _SHOWN:
            assert shown not in answer.text, (seed, answer.text)
        if answer.status_code >= 413:
            detail = told["detail"]
            assert detail
            for words in ("with an unexpected", "could not be saved", "codec can't decode"):
                assert words not in detail, (seed, detail)
            asked = repr(content_of(name, content))
            for own in (".upload-", sys.prefix, str(self.place.server.data_dir)):
                assert own not in detail or own in asked, (seed, detail)
        self.slowest = max(self.slowest, (took, seed))
        return answer.status_code, told, took

    def one(self, seed: int) -> None:
        """One mutation, and, where it names a canary, the same with a name that nothing has."""
        client = self._clients[seed % len(self._clients)]
        names = self.place.names
        name, content = mutated(seed, names)
        status, told, took = self.send(client, seed, name, content)
        detail = told.get("detail", "")
        self.seen["lost its process" if "render process" in detail else "refused" if detail else "taken"] += 1
        other = mutated(seed, [one.replace(NAME, NOBODYS) for one in names])
        if not is_twin((name, content), other):
            return
        self.seen["twins"] += 1
        same, words, seconds = self.send(client, seed, *other)
        self.seconds[NAME].append(took)
        self.seconds[NOBODYS].append(seconds)
        assert same == status, (seed, told, words)
        assert words.get("detail", "").replace(NOBODYS, NAME) == detail, (seed, detail, words)

    def run(self, seeds: range, canary: Canary) -> Counter[str]:
        """All of them, as many at once as there are processes that check scenes."""
        canary.touched()
        began = time.perf_counter()
        with ThreadPoolExecutor(len(self._clients)) as pool:
            for start in range(seeds.start, seeds.stop, 50):
                list(pool.map(self.one, range(start, min(start + 50, seeds.stop))))
                assert canary.touched() == [], (start, start + 50)
        took = time.perf_counter() - began
        print(f"\n{dict(self.seen)}, {len(seeds) / took:.1f}/s, slowest {self.slowest[0]:.2f} s ({self.slowest[1]})")
        middle = {name: sorted(times)[len(times) // 2] for name, times in self.seconds.items() if times}
        print("seconds of an answer, middle:", ", ".join(f"{name} {time_:.4f}" for name, time_ in middle.items()))
        return self.seen


@pytest.fixture
def watched(place: Place) -> Canary:
    return Canary(place.canaries)


def test_mutated_inputs_never_take_the_service_down(place: Place, watched: Canary) -> None:
    seen = Attack(place).run(range(200), watched)
    assert seen["refused"] > 50
    assert seen["taken"] > 5
    assert seen["twins"] > 20
    assert httpx.get(f"{place.server.url}/healthz").status_code == 200


@pytest.mark.fuzz
def test_twenty_thousand_mutated_inputs_never_take_the_service_down(place: Place, watched: Canary) -> None:
    first = int(os.environ.get("FREDHOLM_FUZZ_SEED", time.time_ns() % 2**32))
    count = int(os.environ.get("FREDHOLM_FUZZ_COUNT", "20000"))
    print(f"\nseeds from {first}")
    Attack(place).run(range(first, first + count), watched)
    assert httpx.get(f"{place.server.url}/healthz").status_code == 200


@pytest.mark.parametrize(
    "inner",
    [
        '<shape type="cube"><bsdf type="conductor"><string name="material" value="{}"/></bsdf></shape>',
        '<shape type="cube"><bsdf type="diffuse"><spectrum name="reflectance" filename="{}.spd"/></bsdf></shape>',
        '<shape type="obj"><string name="filename" value="{}.obj"/></shape>',
        '<shape type="linearcurve"><string name="filename" value="{}.txt"/></shape>',
        '<shape type="sdfgrid"><string name="filename" value="{}.vol"/></shape>',
        '<emitter type="envmap"><string name="filename" value="{}.png"/></emitter>',
        '<include filename="{}.xml"/>',
    ],
)
def test_what_lies_elsewhere_is_as_missing_as_what_is_nowhere(place: Place, watched: Canary, inner: str) -> None:
    attack = Attack(place)
    ways = ["{}", "data/ior/{}", "./{}", str(place.server.data_dir / "{}"), "~/{}", "../../../{}", "../0/empty/{}"]
    for way in ways:
        told = []
        for name in (NAME, NOBODYS):
            content = scene(inner.replace("{}", way.replace("{}", name)))
            status, answer, _ = attack.send(attack._clients[0], 0, "a.zip", bundle({"scene.xml": content}))
            assert status == 422, (way, answer)
            told.append(answer["detail"].replace(NOBODYS, NAME))
        assert told[0] == told[1]
    assert watched.touched() == []


def test_the_canaries_tell_when_they_are_read(place: Place, watched: Canary) -> None:
    for path in place.canaries:
        path.read_bytes()
        assert str(path) in watched.touched()


def test_an_input_and_its_twin_differ_in_a_name_alone() -> None:
    one = ("a.zip", bundle({"scene.xml": scene(SKY), "canary": b"1"}))
    assert is_twin(one, ("a.zip", bundle({"scene.xml": scene(SKY), "canarz": b"1"})))
    assert not is_twin(one, ("a.zip", bundle({"scene.xml": scene(SKY), "canarz": b"2"})))
    assert not is_twin(one, one)
