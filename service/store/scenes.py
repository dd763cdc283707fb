"""The verbs of uploaded scenes."""

from __future__ import annotations

from dataclasses import asdict

from sqlalchemy import insert, select

from service.store.database import Database
from service.store.records import SceneRecord, scene_from
from service.store.schema import scenes


class SceneStore:
    """Uploaded scenes. Synchronous: call it from a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, scene: SceneRecord) -> None:
        """Keep a scene."""
        with self._database.write() as connection:
            connection.execute(insert(scenes).values({**asdict(scene), "warnings": list(scene.warnings)}))

    def get(self, scene_id: str) -> SceneRecord | None:
        """One scene, or None."""
        with self._database.read() as connection:
            row = connection.execute(select(scenes).where(scenes.c.id == scene_id)).mappings().first()
            return scene_from(row) if row else None

    def newest(self) -> list[SceneRecord]:
        """All scenes, newest first."""
        with self._database.read() as connection:
            rows = connection.execute(select(scenes).order_by(scenes.c.created_at.desc())).mappings()
            return [scene_from(row) for row in rows]
