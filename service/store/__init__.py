"""Truth that outlives processes: jobs, their transitions and scenes, in a database."""

from service.store.database import Database
from service.store.jobs import JobNotFound, JobStore
from service.store.records import EventRecord, JobRecord, NewJob, Progress, SceneRecord
from service.store.scenes import SceneStore

__all__ = [
    "Database",
    "EventRecord",
    "JobNotFound",
    "JobRecord",
    "JobStore",
    "NewJob",
    "Progress",
    "SceneRecord",
    "SceneStore",
]
