"""The verbs of uploaded scenes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import structlog
from sqlalchemy import ColumnElement, Text, cast, delete, func, insert, literal, select, tuple_
from sqlalchemy.exc import IntegrityError

from service.store.database import Database
from service.store.records import RowUnreadable, SceneRecord, now, scene_from
from service.store.schema import jobs, scene_clients, scenes


class SceneNotFound(Exception):
    """There is no such uploaded scene."""

    def __init__(self, scene_id: str) -> None:
        super().__init__(f"there is no uploaded scene {scene_id!r}")


class SceneDamaged(Exception):
    """The files of an uploaded scene are not what was uploaded."""

    def __init__(self, scene_id: str) -> None:
        super().__init__(f"the files of the uploaded scene {scene_id!r} are damaged on the service's disk")


class SceneStillNeeded(Exception):
    """Jobs are pictures of the scene, or will be."""

    def __init__(self, count: int) -> None:
        what = "1 job still needs this scene; delete it" if count == 1 else f"{count} jobs need this scene; delete them"
        super().__init__(f"{what} first")


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

    def newest(self, client_id: str | None = None, limit: int = 100, before: str | None = None) -> list[SceneRecord]:
        """The scenes of one client or of all, newest first; before: only those older than this one.

        Raises SceneNotFound where that is not among them.
        """
        if before is None:
            return self._select(client_id, limit=limit)
        last = self.get(before, client_id)
        if last is None:
            raise SceneNotFound(before)
        is_older = tuple_(scenes.c.created_at, scenes.c.id) < tuple_(literal(last.created_at), literal(last.id))
        return self._select(client_id, is_older, limit=limit)

    def remove(self, scene_id: str, client_id: str | None = None) -> bool:
        """Forget a scene; with a client: its own upload of it. Whether nobody holds the content any more.

        Raises SceneNotFound, SceneStillNeeded.
        """
        needing = select(func.count()).where(jobs.c.scene_kind == "upload", jobs.c.scene_ref == scene_id)
        held = select(func.count()).where(scene_clients.c.scene_id == scene_id)
        grants = delete(scene_clients).where(scene_clients.c.scene_id == scene_id)
        is_own, needing_own = held, needing
        if client_id is not None:
            is_own = held.where(scene_clients.c.client_id == client_id)
            needing_own = needing.where(jobs.c.client_id == client_id)
            grants = grants.where(scene_clients.c.client_id == client_id)
        with self._database.write() as connection:
            # Locked against those who queue a job of it at this moment.
            known = connection.execute(select(scenes.c.id).where(scenes.c.id == scene_id).with_for_update()).first()
            if known is None or (client_id is not None and not connection.execute(is_own).scalar_one()):
                raise SceneNotFound(scene_id)
            if count := connection.execute(needing_own).scalar_one():
                raise SceneStillNeeded(count)
            connection.execute(grants)
            if connection.execute(held).scalar_one() or connection.execute(needing).scalar_one():
                return False
            connection.execute(delete(scenes).where(scenes.c.id == scene_id))
            return True

    def unneeded_before(self, at: str) -> list[str]:
        """Ids of scenes taken in before `at` that no job refers to."""
        refers = select(jobs.c.id).where(jobs.c.scene_kind == "upload", jobs.c.scene_ref == scenes.c.id)
        query = select(scenes.c.id).where(scenes.c.created_at < at, ~refers.exists())
        with self._database.read() as connection:
            return list(connection.execute(query).scalars())

    def ids(self) -> set[str]:
        """All of them."""
        with self._database.read() as connection:
            return set(connection.execute(select(scenes.c.id)).scalars())

    def _select(
        self, client_id: str | None, *conditions: ColumnElement[bool], limit: int | None = None
    ) -> list[SceneRecord]:
        columns: list[ColumnElement[Any]] = [
            cast(column, Text).label(column.name) if column is scenes.c.warnings else column
            for column in scenes.columns
            if column is not scenes.c.name
        ]
        if client_id is None:
            query = select(scenes.c.name, *columns)
        else:
            query = select(scene_clients.c.name, *columns)
            query = query.join(scene_clients, scene_clients.c.scene_id == scenes.c.id)
            query = query.where(scene_clients.c.client_id == client_id)
        query = query.where(*conditions).order_by(scenes.c.created_at.desc(), scenes.c.id.desc()).limit(limit)
        with self._database.read() as connection:
            rows = connection.execute(query).mappings().all()
        found: list[SceneRecord] = []
        for row in rows:
            try:
                found.append(scene_from(row))
            except RowUnreadable as bad:
                structlog.get_logger("service.store").error("a row cannot be read", scene=bad.row_id, why=bad.reason)
        return found
