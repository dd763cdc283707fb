"""The event stream over real HTTP."""

from __future__ import annotations

import httpx
from event_stream import EventStream, Received
from service_process import LONG, Server


def states_of(events: list[Received], job_id: str) -> list[str]:
    return [event.data["state"] for event in events if event.kind == "job" and event.data["id"] == job_id]


def test_a_stream_says_hello_then_tells_transitions_and_progress(server: Server) -> None:
    with EventStream(server.url) as stream:
        hello = stream.events[0]
        assert hello.kind == "hello"
        assert hello.data["last_event_id"] == int(hello.id or -1)
        assert stream.headers["content-type"].startswith("text/event-stream")
        assert stream.headers["cache-control"] == "no-cache"
        assert stream.headers["x-accel-buffering"] == "no"
        job_id = server.submit(LONG)["id"]
        stream.wait(lambda events: any(e.kind == "progress" and e.data["id"] == job_id for e in events))
        server.cancel(job_id)
        events = stream.wait(lambda events: "cancelled" in states_of(events, job_id))
    assert states_of(events, job_id) == ["queued", "running", "cancelled"]
    transitions = [event for event in events if event.kind == "job"]
    ids = [int(event.id or -1) for event in transitions]
    assert ids == sorted(set(ids))
    assert "curve" not in transitions[0].data
    progress = next(event for event in events if event.kind == "progress")
    assert progress.id is None
    assert progress.data["frame_seq"] > 0
    assert progress.data["state"] == "running"


def places_in(event: Received) -> dict[str, int]:
    return {place["id"]: place["position"] for place in event.data["places"]}


def test_places_in_the_queue_are_told_together_and_change_together(own_server: Server) -> None:
    own_server.environment["FREDHOLM_MAX_RUNNING_JOBS"] = "1"
    own_server.start(wait_until="/healthz")
    with EventStream(own_server.url) as stream:
        first, *ids = [own_server.submit(LONG)["id"] for _ in range(5)]
        own_server.wait(first, lambda job: job["state"] == "running")
        before = {job_id: place for place, job_id in enumerate(ids, start=1)}
        stream.wait(lambda events: any(e.kind == "queue" and places_in(e) == before for e in events))
        own_server.cancel(ids[1])
        after = {ids[0]: 1, ids[2]: 2, ids[3]: 3}
        events = stream.wait(lambda events: any(e.kind == "queue" and places_in(e) == after for e in events))
    for event in events:
        if event.kind == "queue":
            assert sorted(places_in(event).values()) == list(range(1, len(event.data["places"]) + 1))
    with EventStream(own_server.url) as stream:
        told = stream.wait(lambda events: any(e.kind == "queue" for e in events))[1]
        assert places_in(told) == after, "a new stream begins with the queue as it is"


def test_what_was_missed_is_replayed_then_running_jobs_are_told(server: Server) -> None:
    with EventStream(server.url) as stream:
        before = stream.events[0].data["last_event_id"]
    ended = server.wait_ended(server.submit({"spp": 4})["id"])["id"]
    running = server.submit(LONG)["id"]
    server.wait(running, lambda job: job["frame_seq"] > 0)
    with EventStream(server.url, last_event_id=before) as stream:
        events = stream.wait(lambda events: any(e.kind == "progress" for e in events))
        assert states_of(events, ended) == ["queued", "running", "succeeded"]
        assert states_of(events, running) == ["queued", "running"]
        assert next(e for e in events if e.kind == "progress").data["id"] == running
    server.cancel(running)


def test_a_last_event_id_of_another_database_is_answered_with_hello(server: Server) -> None:
    with EventStream(server.url, last_event_id=10**9) as stream:
        assert stream.events[0].kind == "hello"
        assert stream.events[0].id is not None


def test_many_streams_that_are_dropped_leave_the_service_well(server: Server, client: httpx.Client) -> None:
    for _ in range(20):
        with EventStream(server.url):
            pass
    assert client.get("/healthz").status_code == 200


def test_silence_is_broken_by_a_ping(server: Server) -> None:
    with EventStream(server.url) as stream:
        stream.wait(lambda events: [event.kind for event in events].count("ping") >= 2, seconds=25)


def test_others_are_told_of_a_deleted_job(server: Server, client: httpx.Client) -> None:
    job_id = server.wait_ended(server.submit({"spp": 4})["id"])["id"]
    with EventStream(server.url) as stream:
        before = stream.events[0].data["last_event_id"]
        assert client.delete(f"/api/jobs/{job_id}").status_code == 204
        told = stream.wait(lambda events: any(e.kind == "deleted" for e in events))
        deleted = next(event for event in told if event.kind == "deleted")  # places in the queue may be told after it
        assert deleted.data == {"id": job_id}
        assert int(deleted.id or -1) > before
    with EventStream(server.url, last_event_id=before) as stream:
        stream.wait(lambda events: any(e.kind == "deleted" and e.data["id"] == job_id for e in events))
