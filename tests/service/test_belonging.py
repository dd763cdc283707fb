"""The short form of what a folder and its database do for each other: no service is started for these."""

from __future__ import annotations

import os
import stat
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from service_process import wait_for
from sqlalchemy import text
from structlog.testing import capture_logs
from test_store import NEW

from service.data_folder import make_folder, open_database
from service.data_lock import DataFolderInUse, DataLock
from service.estimates import EstimateFiles
from service.quarantine import Quarantine
from service.settings import ServiceSettings
from service.store import Database, DatabaseError, DatabaseReplaced, JobStore


def opened(folder: Path, url: str | None = None) -> Database:
    """The database of a data folder, as a service opens it. Raises DatabaseError."""
    settings = ServiceSettings.model_validate({"data_dir": folder, "database_url": url})
    make_folder(folder)
    database = Database(settings.resolved_database_url)
    open_database(settings, database)
    return database


def test_a_used_folder_is_opened_with_its_own_database_alone(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    opened(folder).close()
    (folder / "estimates" / "j").mkdir(parents=True)
    with pytest.raises(DatabaseError, match="belongs to another database"):
        opened(folder, f"sqlite:///{tmp_path}/other.sqlite")
    opened(folder).close()
    (folder / "fredholm.sqlite").unlink()
    with pytest.raises(DatabaseError, match="put it back"):
        opened(folder)
    assert not (folder / "fredholm.sqlite").exists(), "no empty one takes its place"


def test_tables_of_a_newer_version_are_left_alone(tmp_path: Path) -> None:
    with closing(opened(tmp_path / "data")) as database, database.write() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(DatabaseError, match=r"version 9999.*a newer version has used it"):
        opened(tmp_path / "data")


def test_a_deleted_database_takes_nothing_more_and_what_it_held_is_saved(tmp_path: Path) -> None:
    with closing(opened(tmp_path / "data")) as database:
        jobs = JobStore(database)
        job, _ = jobs.add(NEW)
        for path in (tmp_path / "data").glob("fredholm.sqlite*"):
            path.unlink()
        with pytest.raises(DatabaseReplaced, match="was deleted while the service ran"):
            jobs.add(replace(NEW, name="another"))
        rescued = tmp_path / "data" / "fredholm.sqlite.rescued"
        wait_for(rescued.exists, 60, "a copy of what the deleted file held")
    with pytest.raises(DatabaseError, match=r"what it held is in fredholm\.sqlite\.rescued"):
        opened(tmp_path / "data")
    rescued.rename(tmp_path / "data" / "fredholm.sqlite")
    with closing(opened(tmp_path / "data")) as database:
        assert [one.id for one in JobStore(database).newest(9)] == [job.id]


def test_a_folder_that_others_could_read_is_closed(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    make_folder(tmp_path)
    assert stat.S_IMODE(tmp_path.stat().st_mode) == 0o700


def test_the_lock_is_on_the_folder_and_not_on_a_file_in_it(tmp_path: Path) -> None:
    first, second = DataLock(tmp_path), DataLock(tmp_path)
    first.take()
    (tmp_path / "lock").unlink()
    with pytest.raises(DataFolderInUse):
        second.take()
    first.release()
    second.take()
    second.release()


def test_estimates_that_nothing_names_are_put_away_for_days_and_said(tmp_path: Path) -> None:
    quarantine = Quarantine(tmp_path / "quarantine")
    files = EstimateFiles(tmp_path / "estimates", quarantine)
    files.prepare()
    names = ("gone/1.exr", "j/1.exr", "j/2.exr", "j/3.exr", "odd/1.exr")
    for name in names:
        files.path(name).parent.mkdir(exist_ok=True)
        files.path(name).write_text(name)
    with capture_logs() as lines:
        files.sweep({"j": {"j/2.exr"}, "odd": None})
    kept = {path.read_text() for path in quarantine.folder.rglob("*.exr")}
    assert kept == {"gone/1.exr", "j/3.exr"}, "what no job has, and what is newer than its job says"
    assert {name for name in names if files.path(name).exists()} == {"j/2.exr", "odd/1.exr"}
    assert {line["what"] for line in lines} == {"estimates/gone", "estimates/j/3.exr"}
    assert quarantine.forget_older(14) == 0
    for folder in quarantine.folder.iterdir():
        os.utime(folder, (0, time.time() - 15 * 86400))
    assert quarantine.forget_older(14) == 2
    assert not list(quarantine.folder.iterdir())
    files.remove_displays()
