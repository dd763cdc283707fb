"""The verbs of uploaded scenes."""

from __future__ import annotations

from dataclasses import asdict

from sqlalchemy import ColumnElement, insert, select
from sqlalchemy.exc import IntegrityError

from service.store.database import Database
from service.store.records import SceneRecord, now, scene_from
from service.store.schema import scene_clients, scenes


class SceneStore:
    """Uploaded scenes. Synchronous: call it from a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, scene: SceneRecord) -> None:
        """Keep a scene."""
        with self._database.write() as connection:
            connection.execute(insert(scenes).values({**asdict(scene), "warnings": list(scene.warnings)}))

    def grant(self, scene_id: str, client_id: str, name: str) -> None:
        """Let a client see a scene that it has uploaded, under the name that it gave."""
        try:
            with self._database.write() as connection:
                row = {"scene_id": scene_id, "client_id": client_id, "name": name, "created_at": now()}
                connection.execute(insert(scene_clients).values(row))
        except IntegrityError:
            pass  # uploaded again

    def get(self, scene_id: str, client_id: str | None = None) -> SceneRecord | None:
        """One scene, or None; with a client: one that it has uploaded, under its own name for it."""
        found = self._select(client_id, scenes.c.id == scene_id)
        return found[0] if found else None

    def newest(self, client_id: str | None = None) -> list[SceneRecord]:
        """The scenes of one client or of all, newest first."""
        return self._select(client_id)

    def _select(self, client_id: str | None, *conditions: ColumnElement[bool]) -> list[SceneRecord]:
        columns = list(scenes.columns)
        query = select(*columns)
        if client_id is not None:
            columns[columns.index(scenes.c.name)] = scene_clients.c.name
            query = select(*columns).join(scene_clients, scene_clients.c.scene_id == scenes.c.id)
            query = query.where(scene_clients.c.client_id == client_id)
        with self._database.read() as connection:
            rows = connection.execute(query.where(*conditions).order_by(scenes.c.created_at.desc())).mappings()
            return [scene_from(row) for row in rows]
