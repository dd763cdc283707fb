"""What the server and a render process say to each other.

Plain frozen values; both sides may be killed at any time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from service.store.records import Kept, Progress


@dataclass(frozen=True, slots=True)
class OnCluster:
    """How a render process reaches the cluster. gate: path of a socket. scenes_dir: where uploaded scenes lie."""

    gate: str
    scenes_dir: str


@dataclass(frozen=True, slots=True)
class Turn:
    """One job's turn at the renderer.

    (job_id, attempt) names the live run in the render process; if it is not there, the run starts from the first sound
    one of `kept`, newest first, or from nothing. seconds: of rendering before the turn ends. save: write an estimate
    even if none is due. cluster: where its passes run; None: in the render process.
    """

    job_id: str
    attempt: int
    scene: str
    is_gallery: bool
    target: dict[str, Any]
    settings: dict[str, Any]
    kept: tuple[Kept, ...]
    display_path: str
    estimates_dir: str
    next_seq: int
    seconds: float
    checkpoint_seconds: float
    save: bool = False
    cluster: OnCluster | None = None


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a scene cannot be loaded or rendered. trace: for the log only.

    is_unexpected: nobody foresaw the exception. Raised while a kernel was traced, it may have spoilt those to come:
    the process is to be replaced.
    """

    title: str
    detail: str
    hint: str
    trace: str | None = None
    is_unexpected: bool = False


@dataclass(frozen=True, slots=True)
class Start:
    """How a run began: from which of its saved estimates, None: from nothing. damaged: those passed over, and why."""

    kept: Kept | None
    damaged: tuple[tuple[Kept, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Unsaved:
    """An estimate could not be written: how many bytes it takes, and what the system said."""

    needed_bytes: int
    reason: str


@dataclass(frozen=True, slots=True)
class TurnResult:
    """What a turn led to.

    progress is None if the turn rendered nothing. saved is often a little older: writing goes on beside rendering.
    unsaved: what was rendered is still in the process, and can be saved later. start: of the turn that began the run.
    """

    progress: Progress | None = None
    curve: tuple[dict[str, Any], ...] = ()
    saved: Kept | None = None
    unsaved: Unsaved | None = None
    start: Start | None = None
    stopped_by: str | None = None
    warnings: tuple[str, ...] = ()
    failure: Failure | None = None


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """What loading a scene told. requirements: as `renderer.scene.report.inspect_scene` returns them."""

    width: int = 0
    height: int = 0
    digest: str = ""
    warnings: tuple[str, ...] = field(default=())
    requirements: dict[str, Any] = field(default_factory=dict)
    failure: Failure | None = None
