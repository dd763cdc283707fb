"""Everything that can be set from outside: `FREDHOLM_DATA_DIR`, `FREDHOLM_MAX_PIXELS`, …"""

from __future__ import annotations

import ipaddress
import os
import secrets
import sys
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from service.written_once import written_once

MEBIBYTE = 1024 * 1024


def default_data_dir() -> Path:
    """Where a user's data belongs on this system: jobs, scenes and images are kept there."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "fredholm"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "fredholm"
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "fredholm"


def _networks(text: str) -> str:
    """Addresses or networks, separated by commas. Raises ValueError."""
    for part in filter(None, (part.strip() for part in text.split(","))):
        try:
            ipaddress.ip_network(part, strict=False)
        except ValueError:
            raise ValueError(f"{part!r} is no address or network; write 10.0.0.2 or 10.0.0.0/24") from None
    return text


class ServiceSettings(BaseSettings):
    """Settings of one service; each field is also an environment variable with the prefix FREDHOLM_."""

    model_config = SettingsConfigDict(env_prefix="FREDHOLM_", extra="forbid", frozen=True)

    host: str = "127.0.0.1"
    port: int = Field(default=8017, ge=0, le=65535)
    data_dir: Annotated[Path, AfterValidator(Path.absolute)] = Field(
        default_factory=default_data_dir, description="database, scenes and estimates"
    )
    database_url: SecretStr | None = Field(default=None, description="SQLAlchemy URL; default: SQLite in data_dir")
    cluster: str | None = Field(
        default=None, description="address of a scheduler whose workers render: tls://HOST:PORT; default: this machine"
    )
    cluster_certificates: Path | None = Field(default=None, description="folder with those of the cluster")
    static_dir: Path = Field(default=Path(__file__).parent / "static", description="the built page")

    api_keys: Literal["auto", "on", "off"] = Field(default="auto", description="auto: off on a loopback address only")
    trusted_proxies: Annotated[str, AfterValidator(_networks)] = Field(
        default="", description="addresses or networks, by commas, whose X-Forwarded-For and -Proto are believed"
    )
    requests_per_second: float = Field(default=50.0, gt=0, description="of one client with a key, on average")
    requests_burst: int = Field(default=300, ge=1, description="of one client with a key, at once")
    max_waiting_per_client: int = Field(default=100, ge=1, description="queued jobs of one client")
    max_streams: int = Field(default=1000, ge=1, description="open event streams")
    max_streams_per_client: int = Field(default=64, ge=1, description="open event streams of one client")
    max_samples: int = Field(default=10**13, ge=1, description="pixels × samples per pixel of one job")

    max_body_bytes: int = Field(default=64 * MEBIBYTE, ge=1024, description="body of an upload")
    max_message_bytes: int = Field(default=MEBIBYTE // 4, ge=1024, description="body of any other request")
    max_bundle_files: int = Field(default=2000, ge=1)
    max_bundle_bytes: int = Field(default=512 * MEBIBYTE, ge=1024, description="unpacked size of a zip bundle")
    max_bundle_ratio: float = Field(
        default=200.0, ge=1.0, description="unpacked / packed size of a file over half of max_bundle_bytes"
    )
    max_scene_bytes: int = Field(
        default=2048 * MEBIBYTE, ge=MEBIBYTE, description="memory of one loaded scene, where the machine has enough"
    )
    memory_bytes: int | None = Field(
        default=None, ge=512 * MEBIBYTE, description="of all processes together; default: of the machine or container"
    )
    renderer_memory_bytes: int | None = Field(
        default=None, ge=512 * MEBIBYTE, description="of the render process; default: half of memory_bytes"
    )
    max_estimates_bytes: int | None = Field(
        default=None,
        ge=MEBIBYTE,
        description="saved pictures on disk; default: four fifths of what the disk has for them",
    )
    max_estimates_bytes_per_client: int | None = Field(
        default=None, ge=MEBIBYTE, description="saved pictures of one client with a key; default: half of that"
    )
    max_stored_bytes: int = Field(default=20480 * MEBIBYTE, ge=MEBIBYTE, description="uploaded scenes on disk")
    disk_reserve_bytes: int = Field(
        default=64 * MEBIBYTE, ge=0, description="of disk that jobs and uploads leave free, for the database"
    )
    max_pixels: int = Field(default=3840 * 2160, ge=1, description="pixels of one job's image")
    max_waiting_jobs: int = Field(default=200, ge=1, description="queued jobs; more are refused")
    max_running_jobs: int = Field(default=16, ge=1, description="jobs that share the renderer; others wait")

    turn_seconds: float = Field(default=0.3, gt=0, le=5, description="render time of one job before the next")
    checkpoint_seconds: float = Field(default=5.0, gt=0, description="render time between two saved estimates")
    turn_deadline_seconds: float = Field(
        default=120.0,
        gt=0,
        description="a turn without answer is killed; after ten times the last one where that is more, up to three "
        "times this",
    )
    stop_seconds: float = Field(default=6.0, gt=0, description="time to save what runs when the service ends")
    lease_seconds: float = Field(default=15.0, gt=0, description="silence after which other servers take jobs up")
    heartbeat_seconds: float = Field(default=5.0, gt=0, description="between two renewals of the leases")
    keep_events_days: float = Field(default=7.0, gt=0, description="changes of state that streams can replay")
    keep_jobs_days: float | None = Field(default=None, gt=0, description="ended jobs and their images; for ever")
    keep_scenes_days: float | None = Field(
        default=None, gt=0, description="uploaded scenes that no job needs, since they were last uploaded; for ever"
    )
    keep_quarantine_days: float = Field(default=14.0, gt=0, description="files that no job or scene names any more")
    upload_deadline_seconds: float = Field(default=30.0, gt=0, description="time to check an uploaded scene")
    crash_limit: int = Field(default=3, ge=1, description="render processes a job may crash before it fails")
    warm_up: bool = Field(default=True, description="compile a small scene at start: the first picture comes sooner")

    webhook_private_addresses: bool = Field(
        default=False, description="webhooks may go to this machine and its networks, and by http"
    )

    request_head_seconds: float = Field(default=10.0, gt=0, description="for the head of a request to arrive")
    body_silence_seconds: float = Field(default=30.0, gt=0, description="within a body; then the connection is closed")
    body_seconds: float = Field(default=900.0, gt=0, description="for a whole body, however steadily it comes")
    max_bodies_of_client: int = Field(
        default=32, ge=1, description="bodies over 1 MiB that a client sends at a time; more are refused"
    )
    max_connections: int = Field(default=4096, ge=16, description="open ones, as far as descriptors reach")
    max_unknown_connections: int = Field(
        default=256, ge=8, description="open ones without a known sender; the oldest is closed for one more"
    )
    ping_seconds: float = Field(default=15.0, gt=0, description="silence after which a stream says that it is well")

    log_json: bool = Field(default=False, description="one JSON object per line instead of text")
    log_level: str = Field(default="info", pattern="^(debug|info|warning|error)$")

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach the service."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @cached_property
    def are_keys_required(self) -> bool:
        """Whether a request needs an API key."""
        return self.api_keys == "on" or (self.api_keys == "auto" and not self.is_loopback)

    @property
    def resolved_database_url(self) -> str:
        """SQLAlchemy URL of the database."""
        given = self.database_url.get_secret_value() if self.database_url is not None else ""
        return given or f"sqlite:///{self.data_dir / 'fredholm.sqlite'}"

    @property
    def scenes_dir(self) -> Path:
        """One folder per uploaded scene."""
        return self.data_dir / "scenes"

    @property
    def inspection_dir(self) -> Path:
        """What the processes that check uploads can see: where those come in, and folders of their own."""
        return self.data_dir / "inspection"

    @property
    def estimates_dir(self) -> Path:
        """One folder per job, with its saved estimates."""
        return self.data_dir / "estimates"

    @property
    def database_note(self) -> Path:
        """The id of the database that belongs to this folder."""
        return self.data_dir / "database"

    @property
    def quarantine_dir(self) -> Path:
        """What no job or scene names any more, for some days."""
        return self.data_dir / "quarantine"

    @property
    def secret_file(self) -> Path:
        """The secret with which digests of API keys are made."""
        return self.data_dir / "secret"

    def data_identity(self) -> str:
        """A name of the data folder that moves with it; made at first use."""
        return written_once(self.data_dir / "identity", secrets.token_hex(16))
