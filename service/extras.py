"""What is installed on request only: says which `pip install 'fredholm[…]'` brings a module that is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from renderer.errors import FredholmError

# Extra → the modules that it brings, by the name under which they are imported.
MODULES = {
    "service": frozenset(
        (
            "alembic",
            "fastapi",
            "httptools",
            "prometheus_client",
            "pydantic",
            "pydantic_settings",
            "python_multipart",
            "sqlalchemy",
            "starlette",
            "structlog",
            "uvicorn",
            "zstandard",
        )
    ),
    "postgres": frozenset(("psycopg",)),
    "cluster": frozenset(("cryptography", "distributed")),
}


class MissingExtra(FredholmError, ImportError):
    """A part of Fredholm that is installed on request is missing: pip install 'fredholm[service]'."""


@contextmanager
def explained(what: str) -> Iterator[None]:
    """Turn the lack of a module of an extra into a sentence with the way out. Raises MissingExtra."""
    try:
        yield
    except ModuleNotFoundError as problem:
        module = (problem.name or "").partition(".")[0]
        for extra, modules in MODULES.items():
            if module in modules:
                raise MissingExtra(
                    f"{what} needs {module}, which is not installed: pip install 'fredholm[{extra}]'"
                ) from problem
        raise
