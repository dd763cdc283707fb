"""Truth that outlives processes: jobs, their transitions and scenes, in a database."""

from service.store.database import Database, DatabaseError
from service.store.jobs import JobNotFound, JobStore, KeyUsedOtherwise, QueueFull, QueueLimits, StillRunning, Superseded
from service.store.presence import DatabaseReplaced
from service.store.records import EventRecord, JobRecord, Kept, NewJob, Progress, RowUnreadable, SceneRecord
from service.store.scenes import SceneDamaged, SceneNotFound, SceneStillNeeded, SceneStore

__all__ = [
    "Database",
    "DatabaseError",
    "DatabaseReplaced",
    "EventRecord",
    "JobNotFound",
    "JobRecord",
    "JobStore",
    "Kept",
    "KeyUsedOtherwise",
    "NewJob",
    "Progress",
    "QueueFull",
    "QueueLimits",
    "RowUnreadable",
    "SceneDamaged",
    "SceneNotFound",
    "SceneRecord",
    "SceneStillNeeded",
    "SceneStore",
    "StillRunning",
    "Superseded",
]
