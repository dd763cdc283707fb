"""What operators watch, in Prometheus' text form at /metrics."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram

_WAIT_BUCKETS = (0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3600)
_ANSWER_BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 10)


class Metrics:
    """The figures of one service; each has its own registry, so that several can be in one process."""

    def __init__(self) -> None:
        self.registry = r = CollectorRegistry()
        self.jobs = Gauge("fredholm_jobs", "Jobs by state, now", ["state"], registry=r)
        self.unreadable = Gauge("fredholm_unreadable_rows", "Rows of jobs that this version cannot read", registry=r)
        self.waits = Histogram(
            "fredholm_queue_wait_seconds", "From submission to start", buckets=_WAIT_BUCKETS, registry=r
        )
        self.first_pictures = Histogram(
            "fredholm_first_picture_seconds", "From submission to the first picture", buckets=_WAIT_BUCKETS, registry=r
        )
        self.ended = Counter(
            "fredholm_jobs_left_renderer", "Jobs that left the renderer, by state", ["state"], registry=r
        )
        self.turns = Counter("fredholm_turns", "Turns given to jobs", registry=r)
        self.turn_seconds = Counter("fredholm_turn_seconds", "Time in turns", registry=r)
        self.samples = Counter("fredholm_samples", "Camera paths rendered: its rate is samples per second", registry=r)
        self.errors = Counter("fredholm_errors", "Failures of the service itself", ["where"], registry=r)
        self.restarts = Counter("fredholm_render_process_losses", "Render processes that died or hung", registry=r)
        self.streams = Gauge("fredholm_event_streams", "Open event streams", registry=r)
        self.answers = Histogram(
            "fredholm_answer_seconds",
            "Time to the first byte",
            ["method", "status"],
            buckets=_ANSWER_BUCKETS,
            registry=r,
        )
        self.refusals = Counter("fredholm_refusals", "Requests refused by a limit", ["limit"], registry=r)
        self.budgets = Gauge(
            "fredholm_budget_bytes", "What may be taken: the renderer of memory, estimates of disk", ["of"], registry=r
        )
        self.reckoned = Gauge(
            "fredholm_reckoned_bytes",
            "Of that, what running jobs and the jobs there are reckon with",
            ["of"],
            registry=r,
        )
        self.workers = Gauge(
            "fredholm_cluster_workers",
            "Workers in the cluster, by whether pictures here can use them",
            ["use"],
            registry=r,
        )
        self.worker_passes = Gauge(
            "fredholm_cluster_worker_passes", "Passes that each worker renders or holds ready", ["worker"], registry=r
        )
        self.worker_rendered = Gauge(
            "fredholm_cluster_worker_rendered", "Passes that each worker has rendered for this", ["worker"], registry=r
        )
        self.pass_bytes = Gauge(
            "fredholm_cluster_pass_bytes", "Messages about passes so far, sent and received", ["direction"], registry=r
        )
        self.memory = Gauge("fredholm_memory_bytes", "Resident memory", ["process"], registry=r)

    def turn(self, seconds: float, samples: int) -> None:
        """Note a turn. samples: negative after a crash, where the job went back to its saved estimate."""
        self.turns.inc()
        self.turn_seconds.inc(seconds)
        self.samples.inc(max(0, samples))


def resident_bytes(pid: int | None = None) -> int:
    """Resident memory of a process, 0 where that cannot be told. Elsewhere than on Linux: the peak of this one."""
    status = Path(f"/proc/{pid or 'self'}/statm")
    try:
        return int(status.read_text().split()[1]) * resource.getpagesize()
    except (OSError, ValueError, IndexError):
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return 0 if pid else peak * (1 if sys.platform == "darwin" else 1024)
