"""`fredholm key create | list | revoke`: API keys, kept in the service's database."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from service.clients import Keys
    from service.store.keys import KeyStore

app = typer.Typer(no_args_is_help=True, help="Create, list and revoke the API keys of a service.")

_Data = Annotated[Path | None, typer.Option("--data", help="Folder of the service; FREDHOLM_DATA_DIR by default.")]


@contextmanager
def _opened(data: Path | None) -> Iterator[tuple[Keys, KeyStore]]:
    from service.clients import ClientError, Keys
    from service.data_folder import make_folder, open_database
    from service.serve import ServeError, settings_from
    from service.store import Database, DatabaseError
    from service.store.keys import KeyStore

    settings = settings_from({} if data is None else {"data_dir": data})
    try:
        make_folder(settings.data_dir)
        database = Database(settings.resolved_database_url)
        try:
            open_database(settings, database)
            store = KeyStore(database)
            yield Keys(store, settings.secret_file), store
        finally:
            database.close()
    except (ClientError, DatabaseError) as error:
        raise ServeError(str(error)) from None


@app.command()
def create(
    client: Annotated[str, typer.Argument(help="Whose key it is; several keys may be of one client.")],
    role: Annotated[str, typer.Option(help="read, submit, or admin (sees and changes everyone's jobs).")] = "submit",
    data: _Data = None,
) -> None:
    """Create a key. It is shown this once and stored nowhere.

    [bold]Example[/bold]   fredholm key create alice --role submit
    """
    with _opened(data) as (keys, _):
        record, text = keys.create(client, role)
    typer.echo(f"Key {record.id} of {record.client}, role {record.role}; it is not shown again:", err=True)
    typer.echo(text)


@app.command("list")
def list_keys(data: _Data = None) -> None:
    """List keys: id, client, role, when created and revoked."""
    with _opened(data) as (_, store):
        for key in store.all():
            state = f"revoked {key.revoked_at[:10]}" if key.revoked_at else "in use"
            typer.echo(f"{key.id}  {key.client:24}  {key.role:6}  created {key.created_at[:10]}  {state}")


@app.command()
def revoke(key_id: Annotated[str, typer.Argument(help="The id that `list` shows.")], data: _Data = None) -> None:
    """Revoke a key; a running service refuses it within seconds."""
    with _opened(data) as (_, store):
        is_revoked = store.revoke(key_id)
    if not is_revoked:
        from service.serve import ServeError

        raise ServeError(f"there is no key {key_id} in use; `fredholm key list` shows the keys")
    typer.echo(f"Key {key_id} opens nothing any more.", err=True)
