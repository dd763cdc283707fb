"""The tables. Times are ISO 8601 text in UTC, so that rows read well and sort as time does."""

from __future__ import annotations

from sqlalchemy import JSON, Column, ForeignKey, Index, Integer, MetaData, Table, Text

metadata = MetaData()

jobs = Table(
    "jobs",
    metadata,
    Column("number", Integer, primary_key=True, autoincrement=True),  # order of arrival
    Column("id", Text, nullable=False, unique=True),
    Column("name", Text, nullable=False),
    Column("scene_kind", Text, nullable=False),  # gallery | upload
    Column("scene_ref", Text, nullable=False),  # gallery name | scenes.id
    Column("scene_name", Text, nullable=False),
    Column("state", Text, nullable=False),
    Column("target", JSON, nullable=False),
    Column("settings", JSON, nullable=False),
    Column("created_at", Text, nullable=False),
    Column("started_at", Text),
    Column("finished_at", Text),
    # Grows with every start: results of an older attempt change 0 rows.
    Column("attempt", Integer, nullable=False, default=0),
    Column("crashes", Integer, nullable=False, default=0),
    Column("checkpoint", Text),  # path of the saved estimate, relative to the folder of estimates
    Column("frame_seq", Integer, nullable=False, default=0),
    Column("progress", JSON, nullable=False),
    Column("curve", JSON, nullable=False),
    Column("stopped_by", Text),
    Column("cause", JSON),
    Column("warnings", JSON, nullable=False),
    sqlite_autoincrement=True,
)
Index("jobs_by_state", jobs.c.state, jobs.c.number)

events = Table(
    "events",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=True),  # the id of the event stream
    Column("job_id", Text, ForeignKey("jobs.id", ondelete="CASCADE"), nullable=False, index=True),
    Column("at", Text, nullable=False),
    Column("queue_position", Integer),
    Column("job", JSON, nullable=False),  # the row as it was, without curve
    sqlite_autoincrement=True,
)

scenes = Table(
    "scenes",
    metadata,
    Column("id", Text, primary_key=True),
    Column("name", Text, nullable=False),
    Column("path", Text, nullable=False),  # of the .xml, relative to the folder of scenes
    Column("width", Integer, nullable=False),
    Column("height", Integer, nullable=False),
    Column("digest", Text, nullable=False),
    Column("warnings", JSON, nullable=False),
    Column("created_at", Text, nullable=False),
)
