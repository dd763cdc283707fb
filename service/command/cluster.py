"""The commands `fredholm worker` and `fredholm cluster …`: one picture on many machines."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from service.command.arguments import limit_threads
from service.command.console import say

app = typer.Typer(no_args_is_help=True, help="Scheduler and certificates of a cluster; see `fredholm worker`, too.")

DEFAULT_PORT = 8786
_Certificates = Annotated[
    Path | None,
    typer.Option(envvar="FREDHOLM_CLUSTER_CERTIFICATES", help="Folder with them; needed off 127.0.0.1."),
]


def work(
    scheduler: Annotated[str, typer.Argument(help="tls://HOST:PORT, or tcp://127.0.0.1:PORT on one machine.")],
    name: Annotated[str | None, typer.Option(help="Of this worker; host and process by default.")] = None,
    folder: Annotated[
        Path | None, typer.Option(help="Keeps scenes from run to run; else they go when the worker ends.")
    ] = None,
    cache_gib: Annotated[float, typer.Option(min=0.001, help="GiB of scenes to keep.")] = 20.0,
    host: Annotated[str | None, typer.Option(help="Address to listen on; the one that leads to the scheduler.")] = None,
    certificates: _Certificates = None,
    threads: Annotated[
        int | None, typer.Option(min=1, max=9999, help="Of the processor; all by default.", envvar="FREDHOLM_THREADS")
    ] = None,
) -> None:
    """Render passes for the services of a cluster, until it is interrupted.

    [bold]Examples[/bold]

      fredholm worker tcp://127.0.0.1:8786
      fredholm worker tls://farm:8786 --certificates ~/certificates --folder /var/cache/fredholm
      CUDA_VISIBLE_DEVICES=1 fredholm worker tls://farm:8786 --certificates ~/certificates --name gpu1

    One per GPU, or one per machine. It renders in a process of its own; a scheduler that goes is waited for. Exit
    codes: 0 ended by Ctrl-C or SIGTERM, 2 bad input.
    """
    from service.cluster.run import run_worker

    limit_threads(threads)
    run_worker(scheduler, name, folder, host, certificates, int(cache_gib * 2**30))


@app.command("scheduler")
def schedule(
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")] = DEFAULT_PORT,
    certificates: _Certificates = None,
) -> None:
    """Run the scheduler of a cluster: services send passes to it, and workers take them.

    [bold]Examples[/bold]

      fredholm cluster scheduler
      fredholm cluster scheduler --host 0.0.0.0 --certificates ~/certificates

    Off 127.0.0.1 it needs certificates: whoever can speak to it can run programs on all machines of the cluster.
    """
    from service.cluster.run import run_scheduler

    run_scheduler(host, port, certificates)


@app.command("certificates")
def certify(
    folder: Annotated[Path, typer.Argument(help="Where to write them.")],
    days: Annotated[int, typer.Option(min=1, max=3650, help="How long they are valid.")] = 365,
) -> None:
    """Make the certificates with which the parts of a cluster know each other.

    [bold]Example[/bold]   fredholm cluster certificates ~/certificates

    Copy ca.pem and, by its role, scheduler.*, worker.* or service.* to each machine. ca.key makes more of them: keep it
    to yourself. A second call with the same folder renews those of the roles.
    """
    from service.cluster.certificates import make_certificates

    made = make_certificates(folder, days)
    say(f"{folder}: {', '.join(path.name for path in made)}, valid for {days} days")
    say("Copy ca.pem and the two files of its role to each machine; ca.key goes nowhere.")
