"""Who may speak to a cluster: programs of this machine, or holders of certificates of its own authority.

The scheduler and the workers run what they are sent, so whoever reaches them can use their machines. On a loopback
address that is this machine's own users; on any other, all connections are TLS and both sides show a certificate.
"""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from urllib.parse import urlsplit

from renderer.errors import FredholmError

if TYPE_CHECKING:
    from distributed import Security

Role = Literal["scheduler", "worker", "service"]
_ROLE_OF_DASK = {"scheduler": "scheduler", "worker": "worker", "service": "client"}


class ClusterError(FredholmError):
    """The cluster cannot be used as it is asked for."""


def check_installed() -> None:
    """Raises ClusterError where the extra is missing."""
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise ClusterError(
            "a cluster needs Dask's distributed; install it with: pip install 'fredholm[cluster]'"
        ) from None


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def check_address(address: str, certificates: Path | None) -> tuple[str, int]:
    """Host and port of a scheduler. Raises ClusterError for what is no address, or would be open to everyone."""
    parts = urlsplit(address)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if parts.scheme not in ("tcp", "tls") or not host or not port or parts.path:
        raise ClusterError(
            f"the address of the cluster is {address!r}; write it as tls://HOST:PORT or tcp://127.0.0.1:PORT"
        )
    check_reach(host, certificates)
    wanted = "tcp" if certificates is None else "tls"
    if parts.scheme != wanted:
        how = "with" if certificates else "without"
        raise ClusterError(f"the address of the cluster is {address!r}; {how} certificates it begins with {wanted}://")
    return host, port


def check_reach(host: str, certificates: Path | None) -> None:
    """Raises ClusterError where others than this machine's users could give orders."""
    if certificates is None and not is_loopback(host):
        raise ClusterError(
            f"without certificates anyone who reaches {host} could run programs on all machines of the cluster; make "
            "some with `fredholm cluster certificates FOLDER`, give the folder as --certificates, and write the "
            "address as tls://HOST:PORT; or stay on 127.0.0.1"
        )


def security_for(role: Role, certificates: Path | None) -> Security | None:
    """What connections of this role need; None on loopback. Raises ClusterError where a file is missing."""
    from distributed import Security

    if certificates is None:
        return None
    files = {"ca": certificates / "ca.pem", "cert": certificates / f"{role}.pem", "key": certificates / f"{role}.key"}
    for file in files.values():
        if not file.is_file():
            raise ClusterError(
                f"{file} is missing; a {role} needs {', '.join(one.name for one in files.values())} in the folder of "
                "certificates: copy them from where `fredholm cluster certificates` made them"
            )
    dask = _ROLE_OF_DASK[role]
    own = {f"tls_{dask}_cert": str(files["cert"]), f"tls_{dask}_key": str(files["key"])}
    return Security(require_encryption=True, tls_ca_file=str(files["ca"]), **own)
