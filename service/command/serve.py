"""The command `fredholm serve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on; 127.0.0.1 by default.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 8017 by default.")] = None,
    data: Annotated[Path | None, typer.Option(help="Folder for jobs, scenes and images.")] = None,
    database: Annotated[str | None, typer.Option(help="SQLAlchemy URL; SQLite in the data folder by default.")] = None,
    cluster: Annotated[
        str | None, typer.Option(help="Render on the workers of this scheduler: tls://HOST:PORT, tcp://127.0.0.1:PORT.")
    ] = None,
    certificates: Annotated[Path | None, typer.Option(help="Folder with those of the cluster.")] = None,
    open_browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
) -> None:
    """Serve the page and the HTTP API. What is not given comes from FREDHOLM_HOST, FREDHOLM_PORT, FREDHOLM_DATA_DIR,
    FREDHOLM_DATABASE_URL, FREDHOLM_CLUSTER, FREDHOLM_CLUSTER_CERTIFICATES.

    [bold]Examples[/bold]

      fredholm serve --port 8017 --data ~/fredholm
      fredholm serve --cluster tls://farm:8786 --certificates ~/certificates
    """
    from service.serve import run

    more = {"database_url": database, "cluster": cluster, "cluster_certificates": certificates}
    run(host=host, port=port, data_dir=data, open_browser=open_browser, more=more)
