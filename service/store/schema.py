"""The tables. Times are ISO 8601 text in UTC, so that rows read well and sort as time does.

A change here needs a step in `migrations/versions`; a test compares the two.
"""

from __future__ import annotations

from sqlalchemy import JSON, Column, ForeignKey, Index, Integer, MetaData, Table, Text

metadata = MetaData()

jobs = Table(
    "jobs",
    metadata,
    Column("number", Integer, primary_key=True, autoincrement=True),  # order of arrival
    Column("id", Text, nullable=False, unique=True),
    Column("client_id", Text, nullable=False, server_default=""),  # whose job it is; "" where no keys are asked for
    Column("priority", Integer, nullable=False, server_default="0"),  # among the client's own jobs
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
    Column("checkpoint_digest", Text),  # sha256 of that file; null: saved by an older version
    Column("earlier", JSON(none_as_null=True)),  # the estimate saved before it: name, digest, progress
    Column("losses", JSON(none_as_null=True)),  # sentences: what was lost of the job, and why
    Column("frame_seq", Integer, nullable=False, default=0),
    Column("progress", JSON, nullable=False),
    Column("curve", JSON, nullable=False),
    Column("stopped_by", Text),
    Column("cause", JSON(none_as_null=True)),
    Column("warnings", JSON, nullable=False),
    # The server that runs it, and until when it may be silent before others take the job up.
    Column("lease_owner", Text),
    Column("lease_until", Text),
    # A repeated submission with the same key finds the job of the first one.
    Column("idempotency_key", Text),
    Column("request_digest", Text),
    Column("series", Text),  # the same for jobs that were queued together; null: alone
    sqlite_autoincrement=True,
)
Index("jobs_by_state", jobs.c.state, jobs.c.number)
Index("jobs_by_series", jobs.c.series)
Index("jobs_by_client", jobs.c.client_id, jobs.c.state)
Index("jobs_by_idempotency_key", jobs.c.client_id, jobs.c.idempotency_key, unique=True)

events = Table(
    "events",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=True),  # the id of the event stream
    Column("job_id", Text, nullable=False),  # not a foreign key: that a job was deleted is an event too
    Column("client_id", Text, nullable=False, server_default=""),
    Column("at", Text, nullable=False),
    Column("queue_position", Integer),
    Column("job", JSON(none_as_null=True)),  # the row as it was, without curve; null: the job was deleted
    Index("events_by_job", "job_id"),
    Index("events_by_time", "at"),
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

# Who uploaded a scene, and under which name: the same content from two clients is stored once.
scene_clients = Table(
    "scene_clients",
    metadata,
    Column("scene_id", Text, ForeignKey("scenes.id", ondelete="CASCADE"), primary_key=True),
    Column("client_id", Text, primary_key=True),
    Column("name", Text, nullable=False),
    Column("created_at", Text, nullable=False),
)

api_keys = Table(
    "api_keys",
    metadata,
    Column("id", Text, primary_key=True),
    Column("client", Text, nullable=False),  # whose key it is; several keys may be of one client
    Column("role", Text, nullable=False),  # read | submit | admin
    Column("digest", Text, nullable=False, unique=True),  # keyed digest of the key, which is stored nowhere
    Column("created_at", Text, nullable=False),
    Column("revoked_at", Text),
)

# Who is told of a job's end.
webhooks = Table(
    "webhooks",
    metadata,
    Column("job_id", Text, primary_key=True),
    Column("url", Text, nullable=False),
    Column("secret", Text, nullable=False),  # in no event and no answer
)

# What has still to be told: a row is gone once it was heard or given up.
webhook_deliveries = Table(
    "webhook_deliveries",
    metadata,
    Column("id", Text, primary_key=True),
    Column("job_id", Text, nullable=False),  # not a foreign key: the end of a job that was deleted is told too
    Column("url", Text, nullable=False),
    Column("secret", Text, nullable=False),
    Column("body", Text, nullable=False),
    Column("attempts", Integer, nullable=False, server_default="0"),
    Column("due_at", Text, nullable=False),
    Index("webhook_deliveries_by_time", "due_at"),
)

# The data folder that this database belongs to: its jobs name files in there. One row.
data_folder = Table(
    "data_folder",
    metadata,
    Column("identity", Text, primary_key=True),
    Column("database_id", Text),  # of this database; its folder keeps it too
)
