"""Memory and disk are accounted for: what can never fit is refused with figures, what does not fit now waits."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from service_process import LONG, Server

from service.accountant import Accountant, Ledger, Need, Quota, QuotaReached, reckon
from service.admission import Admission, choose
from service.dispatch import Waiting
from service.machine import Machine
from service.room import Disk, Shortage, job_bytes
from service.settings import MEBIBYTE, ServiceSettings

GIGABYTE = 1 << 30


class Told(Machine):
    """A machine with so much memory, of which so much is free."""

    def __init__(self, memory: int, free: int) -> None:
        self._memory, self._free = memory, free

    def memory(self) -> int:
        return self._memory

    def available(self) -> int:
        return self._free


def accountant(memory: int = 4 * GIGABYTE, free: int = 4 * GIGABYTE, **settings: int) -> Accountant:
    return Accountant(ServiceSettings.model_validate(settings), Told(memory, free))


def test_a_container_s_limit_counts_and_what_its_files_take_can_be_given_back(tmp_path: Path) -> None:
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 4194304 kB\nMemAvailable: 3145728 kB\n")
    plain = Machine(tmp_path, meminfo)
    assert (plain.memory(), plain.available()) == (4 * GIGABYTE, 3 * GIGABYTE)
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "memory.current").write_text("5\n")
    (tmp_path / "memory.stat").write_text("anon 1\n")
    assert plain.memory() == 4 * GIGABYTE
    (tmp_path / "memory.max").write_text(f"{GIGABYTE}\n")
    (tmp_path / "memory.current").write_text(f"{GIGABYTE - 4096}\n")
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 8192\n")
    assert (plain.memory(), plain.available()) == (GIGABYTE, 4096 + 8192)


def test_limits_follow_from_the_machine_unless_they_are_set() -> None:
    assert accountant(8 * GIGABYTE).renderer_bytes == 4 * GIGABYTE
    assert accountant(8 * GIGABYTE, renderer_memory_bytes=GIGABYTE).renderer_bytes == GIGABYTE
    assert accountant(8 * GIGABYTE, memory_bytes=2 * GIGABYTE).renderer_bytes == GIGABYTE
    large, small = accountant(64 * GIGABYTE), accountant(8 * GIGABYTE)
    assert large.scene_bytes(3) == ServiceSettings().max_scene_bytes
    assert 3 * (2 * small.scene_bytes(3) + 250 * MEBIBYTE) <= 3 / 8 * 8 * GIGABYTE


def test_jobs_that_never_fit_are_told_the_figures_and_the_largest_that_would() -> None:
    room = accountant(memory=2 * GIGABYTE)
    why = room.never_fits(Need(3840 * 2160))
    assert why is not None
    most = int(why.partition("at most ")[2].split()[0])
    assert room.never_fits(Need(most)) is None
    assert room.never_fits(Need(most + 1)) is not None
    assert "1.07 GB" in why, "what the renderer may have"
    scene = room.never_fits(Need(1, scene="s", scene_bytes=GIGABYTE))
    assert scene is not None
    assert "smaller scene" in scene


def test_a_scene_that_running_jobs_share_is_counted_once() -> None:
    one, two = Need(100, scene="s", scene_bytes=GIGABYTE), Need(100, scene="s", scene_bytes=GIGABYTE)
    assert reckon([one, two]) - reckon([one]) < 1_000_000


def test_memory_that_other_programs_take_counts_too() -> None:
    idle, busy = accountant(), accountant(free=150 * MEBIBYTE)
    need = Need(512 * 512)
    assert idle.shortage(need, []) is None
    shortage = busy.shortage(need, [])
    assert shortage is not None
    assert shortage.what == "memory"
    assert shortage.needed > shortage.free


def test_what_a_job_shows_in_shared_memory_counts_too() -> None:
    need = Need(4096 * 4096)
    growth = accountant(64 * GIGABYTE, 0).shortage(need, [])
    assert growth is not None
    assert growth.needed >= reckon([need]) - reckon([]) + 33 * need.pixels
    assert accountant(64 * GIGABYTE, growth.needed + 127 * MEBIBYTE).shortage(need, []) is not None
    assert accountant(64 * GIGABYTE, growth.needed + 128 * MEBIBYTE).shortage(need, []) is None


def test_jobs_that_do_not_fit_are_passed_by_those_that_do() -> None:
    queue = [Waiting("big", 1, False, "a"), Waiting("other", 2, False, "b"), Waiting("small", 3, False, "a")]
    lack = Shortage(2, 1, "memory")
    found = choose(queue, {}, 2, {"big": lack}.get)
    assert found.job is not None
    assert (found.job.job_id, dict(found.passed)) == ("other", {"big": lack})
    found = choose(queue, {}, 2, {"big": lack, "other": lack, "small": lack}.get)
    assert (found.job, len(found.passed)) == (None, 3)
    found = choose(queue, {"a": 1, "c": 1}, 2, {"other": lack}.get)
    assert (found.job, list(found.passed)) == (None, ["other"]), "a has a job that runs, and no slot is free"


def test_a_job_that_was_passed_for_long_is_next() -> None:
    queue = [Waiting("big", 1, False, "a"), Waiting("small", 2, False, "b")]
    lacks = {"big": Shortage(2, 1, "memory")}.get
    assert choose(queue, {"c": 1}, 4, lacks, lambda _: False).job is None, "what runs ends, and then there is room"
    found = choose(queue, {}, 4, lacks, lambda _: False)
    assert found.job is not None
    assert found.job.job_id == "small", "where nothing runs, waiting would not help"


def test_nothing_is_started_on_a_full_disk_and_jobs_say_so(tmp_path: Path) -> None:
    store: Any = SimpleNamespace(queue=lambda: [Waiting("a", 1, False, "c")], get=lambda _: None)
    for reserve, started in ((1 << 62, None), (0, "a")):
        admission = Admission(store, Disk(tmp_path, reserve), accountant(), 4, lambda _: Need(1))
        found = admission.look({})
        assert (found.job and found.job.job_id) == started
        assert admission.waits == (started is None)
        shortage = admission.shortage_of("a")
        assert (shortage and shortage.what) == (None if started else "disk")


def test_estimates_have_a_quota_that_reservations_keep() -> None:
    ledger = Ledger()
    ledger.quota = Quota(100, 60)
    with ledger.reserved("a", 50) as keep:
        with pytest.raises(QuotaReached, match="of one client"), ledger.reserved("a", 20):
            pass
        with ledger.reserved("b", 50), pytest.raises(QuotaReached, match="of this service"), ledger.reserved("c", 1):
            pass
        keep("first")
    assert ledger.taken() == 50
    with ledger.reserved("a", 55, "first") as keep:
        keep("first")
    assert ledger.taken() == 55, "a job that goes on takes the place of what it had"
    ledger.resize("first", 30)
    with ledger.reserved("a", 30):
        assert ledger.taken() == 60
    ledger.forget("first")
    assert ledger.taken() == 0


def test_a_job_waits_for_memory_says_so_and_starts_by_itself(own_server: Server) -> None:
    size, small = {"width": 256, "height": 256, "seed": 1}, {"width": 32, "height": 32, "seed": 1}
    one, two = Need(256 * 256), [Need(256 * 256)] * 2
    budget = (reckon([one]) + reckon(two)) // 2
    own_server.environment |= {"FREDHOLM_RENDERER_MEMORY_BYTES": str(budget)}
    server = own_server.start(wait_until="/healthz")
    first = server.submit(LONG, size)["id"]
    server.wait(first, lambda job: job["state"] == "running")
    second = server.submit({"spp": 4}, size)["id"]
    held = server.wait(second, lambda job: job["waits_for"] is not None)
    assert held["state"] == "queued"
    assert "of memory" in held["waits_for"]
    listed = httpx.get(f"{server.url}/api/jobs").json()["jobs"]
    assert [job["waits_for"] for job in listed if job["id"] == second] == [held["waits_for"]]
    assert any("of memory" in why for why in httpx.get(f"{server.url}/readyz").json()["not_ready"])
    passing = server.submit({"spp": 4}, small)["id"]
    assert server.wait_ended(passing)["state"] == "succeeded", "what fits is not kept back"
    assert server.job(second)["state"] == "queued"
    lines = httpx.get(f"{server.url}/metrics").text.splitlines()
    figures = dict(line.rsplit(" ", 1) for line in lines if line.startswith("fredholm_"))
    assert float(figures['fredholm_budget_bytes{of="renderer"}']) == budget
    assert reckon([one]) <= float(figures['fredholm_reckoned_bytes{of="renderer"}']) <= budget
    too_large = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 1}, "settings": {"width": 2000, "height": 2000}}
    refusal = httpx.post(f"{server.url}/api/jobs", json=too_large)
    assert refusal.status_code == 422
    assert "ask for at most" in refusal.json()["detail"]
    server.cancel(first)
    assert server.wait_ended(second)["state"] == "succeeded"


def test_pictures_on_disk_have_a_quota_and_deleted_jobs_make_room(own_server: Server) -> None:
    size = {"width": 64, "height": 64, "seed": 1}
    limit = max(1 << 20, int(1.5 * job_bytes(size)))
    n_fit = limit // job_bytes(size)
    own_server.environment |= {"FREDHOLM_MAX_ESTIMATES_BYTES": str(limit)}
    server = own_server.start(wait_until="/healthz")
    ids = [server.submit(LONG, size)["id"] for _ in range(n_fit)]
    body = {"scene": {"gallery": "cornell-box"}, "target": {"spp": 4}, "settings": size}
    refusal = httpx.post(f"{server.url}/api/jobs", json=body)
    assert refusal.status_code == 507, refusal.text
    assert "delete jobs" in refusal.json()["detail"]
    server.kill()
    server.start(wait_until="/healthz")
    assert httpx.post(f"{server.url}/api/jobs", json=body).status_code == 507, "a restart forgets nothing"
    server.cancel(ids[0])
    assert httpx.delete(f"{server.url}/api/jobs/{ids[0]}").status_code == 204
    assert httpx.post(f"{server.url}/api/jobs", json=body).status_code == 201
    for job_id in ids[1:]:
        server.cancel(job_id)
