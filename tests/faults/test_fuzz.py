"""Mutated uploads: whatever is sent, the service answers with a clear problem and reads no file outside the bundle.

200 mutations here with fixed seeds; `make fuzz` sends 10,000 others.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from pathlib import Path

import httpx
import pytest

from tests.faults.canary import Canary
from tests.faults.mutate import mutated
from tests.service.service_process import Server


def attack(server: Server, canaries: list[Path], canary: Canary, seeds: range) -> Counter[str]:
    """Sends mutated inputs; how many were taken, refused, and cost the loading process its life."""
    seen: Counter[str] = Counter()
    assert server.process is not None
    asked = [str(path) for path in canaries] + [os.path.relpath(canaries[0], server.data_dir / "scenes" / "x" / "y")]
    canary.touched()
    slowest = (0.0, 0)
    with httpx.Client(base_url=server.url, timeout=60) as client:
        for seed in seeds:
            name, content = mutated(seed, asked)
            began = time.perf_counter()
            answer = client.post("/api/scenes", files={"file": (name, content)})
            slowest = max(slowest, (time.perf_counter() - began, seed))
            assert answer.status_code in (200, 201, 413, 422), (seed, answer.status_code, answer.text)
            assert server.process.poll() is None, seed
            if answer.status_code >= 413:
                detail = answer.json()["detail"]
                assert detail
                assert "with an unexpected" not in detail, (seed, detail)
                assert "could not be saved" not in detail, (seed, detail)
                seen["lost its process" if "render process" in detail else "refused"] += 1
            else:
                seen["taken"] += 1
            assert canary.touched() == [], seed
    print(f"\n{dict(seen)}, slowest {slowest[0]:.2f} s (seed {slowest[1]})")
    return seen


def test_mutated_inputs_never_take_the_service_down(victim: Server, canaries: list[Path], canary: Canary) -> None:
    seen = attack(victim, canaries, canary, range(200))
    assert seen["refused"] > 50
    assert seen["taken"] > 5
    assert httpx.get(f"{victim.url}/healthz").status_code == 200


@pytest.mark.fuzz
def test_ten_thousand_mutated_inputs_never_take_the_service_down(
    victim: Server, canaries: list[Path], canary: Canary
) -> None:
    first = int(os.environ.get("FREDHOLM_FUZZ_SEED", time.time_ns() % 2**32))
    count = int(os.environ.get("FREDHOLM_FUZZ_COUNT", "10000"))
    print(f"\nseeds from {first}")
    attack(victim, canaries, canary, range(first, first + count))
    assert httpx.get(f"{victim.url}/healthz").status_code == 200


def test_the_canaries_tell_when_they_are_read(canaries: list[Path], canary: Canary) -> None:
    canary.touched()
    canaries[0].read_bytes()
    assert str(canaries[0]) in canary.touched()
