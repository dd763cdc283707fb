"""What is told of a job's end: written in the transaction that ends it, taken up until somebody has heard it."""

from __future__ import annotations

import json
import secrets
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import Connection, delete, insert, select, update

from service.store.database import Database
from service.store.records import JobRecord, iso, now
from service.store.schema import webhook_deliveries as deliveries
from service.store.schema import webhooks

# The schedule that Standard Webhooks recommends: seconds from one attempt to the next.
BACKOFF_SECONDS = (5, 300, 1800, 7200, 18_000, 36_000, 50_400, 72_000, 86_400)


@dataclass(frozen=True, slots=True)
class Webhook:
    """Who is told, and the secret that signs it: whsec_ and base64."""

    url: str
    secret: str


@dataclass(frozen=True, slots=True)
class Delivery:
    """A message on its way. id: the same in every attempt. attempts: made or begun."""

    id: str
    job_id: str
    url: str
    secret: str
    body: str
    attempts: int
    due_at: str

    @property
    def is_last_attempt(self) -> bool:
        """Whether nothing is tried after this one."""
        return self.attempts > len(BACKOFF_SECONDS)


def remember(connection: Connection, job_id: str, webhook: Webhook) -> None:
    """In the transaction that queues a job: who is to be told of its end."""
    connection.execute(insert(webhooks).values(job_id=job_id, url=webhook.url, secret=webhook.secret))


def forget(connection: Connection, job_id: str) -> None:
    """In the transaction that deletes a job: what is on its way still arrives."""
    connection.execute(delete(webhooks).where(webhooks.c.job_id == job_id))


def queue_message(connection: Connection, job: JobRecord) -> None:
    """In the transaction that ends a job: one message for each end, if somebody is to be told."""
    who = connection.execute(select(webhooks).where(webhooks.c.job_id == job.id)).mappings().first()
    if who is None:
        return
    row = {
        "id": f"msg_{secrets.token_hex(12)}",
        "job_id": job.id,
        "url": who["url"],
        "secret": who["secret"],
        "body": json.dumps(message_of(job), ensure_ascii=False, allow_nan=False),
        "due_at": now(),
    }
    connection.execute(insert(deliveries).values(row))


def message_of(job: JobRecord) -> dict[str, object]:
    """What is told: enough to know whether to fetch the picture. error: null where error_unknown says why."""
    progress = job.progress
    return {
        "type": f"job.{job.state.value}",
        "timestamp": job.finished_at,
        "data": {
            "id": job.id,
            "name": job.name,
            "state": job.state.value,
            "stopped_by": job.stopped_by,
            "error": progress.error,
            "error_upper": progress.error_upper,
            "error_unknown": progress.error_unknown,
            "spp": progress.spp,
            "seconds": progress.seconds,
            "cause": job.cause,
        },
    }


class WebhookStore:
    """Messages on their way. Synchronous: call it from a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def is_any_due(self) -> bool:
        """Whether an attempt is to be made now."""
        query = select(deliveries.c.id).where(deliveries.c.due_at <= now()).limit(1)
        with self._database.read() as connection:
            return connection.execute(query).first() is not None

    def take(self, most: int) -> list[Delivery]:
        """Messages that are due, each with its next attempt planned: whoever dies now has lost one attempt, and no two
        servers make the same one.
        """
        due = select(deliveries).where(deliveries.c.due_at <= now()).order_by(deliveries.c.due_at).limit(most)
        taken: list[Delivery] = []
        with self._database.write() as connection:
            for row in connection.execute(due.with_for_update(skip_locked=True)).mappings().all():
                attempts = row["attempts"] + 1
                pause = BACKOFF_SECONDS[min(attempts, len(BACKOFF_SECONDS)) - 1]
                later = iso(datetime.now(UTC) + timedelta(seconds=pause))
                one = Delivery(**{**row, "attempts": attempts, "due_at": later})
                changed = update(deliveries).where(deliveries.c.id == one.id)
                connection.execute(changed.values(attempts=attempts, due_at=later))
                taken.append(one)
        return taken

    def finish(self, delivery_id: str) -> None:
        """It was heard, or nobody will hear it: it is not told again."""
        with self._database.write() as connection:
            connection.execute(delete(deliveries).where(deliveries.c.id == delivery_id))
