"""The verbs of API keys."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from sqlalchemy import insert, select, update

from service.store.database import Database
from service.store.records import now
from service.store.schema import api_keys


@dataclass(frozen=True, slots=True)
class KeyRecord:
    """One API key as stored. role: read, submit or admin."""

    id: str
    client: str
    role: str
    digest: str
    created_at: str
    revoked_at: str | None


class KeyStore:
    """API keys. Synchronous: call it from a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, key: KeyRecord) -> None:
        """Keep a key."""
        with self._database.write() as connection:
            connection.execute(insert(api_keys).values(asdict(key)))

    def get(self, key_id: str) -> KeyRecord | None:
        """One key, or None."""
        with self._database.read() as connection:
            row = connection.execute(select(api_keys).where(api_keys.c.id == key_id)).mappings().first()
            return KeyRecord(**row) if row else None

    def all(self) -> list[KeyRecord]:
        """All keys, oldest first, revoked ones too."""
        with self._database.read() as connection:
            rows = connection.execute(select(api_keys).order_by(api_keys.c.created_at)).mappings()
            return [KeyRecord(**row) for row in rows]

    def revoke(self, key_id: str) -> bool:
        """Let a key open nothing any more. False if there is no such key in use."""
        statement = update(api_keys).where(api_keys.c.id == key_id, api_keys.c.revoked_at.is_(None))
        with self._database.write() as connection:
            return connection.execute(statement.values(revoked_at=now())).rowcount == 1
