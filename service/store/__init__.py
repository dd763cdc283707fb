"""Truth that outlives processes: jobs, their transitions and scenes, in a database."""

from service.store.database import Database, DatabaseError
from service.store.jobs import JobNotFound, JobStore, KeyUsedOtherwise, StillRunning, Superseded
from service.store.records import EventRecord, JobRecord, NewJob, Progress, SceneRecord
from service.store.scenes import SceneNotFound, SceneStillNeeded, SceneStore

__all__ = [
    "Database",
    "DatabaseError",
    "EventRecord",
    "JobNotFound",
    "JobRecord",
    "JobStore",
    "KeyUsedOtherwise",
    "NewJob",
    "Progress",
    "SceneNotFound",
    "SceneRecord",
    "SceneStillNeeded",
    "SceneStore",
    "StillRunning",
    "Superseded",
]
