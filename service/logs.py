"""Structured logs: text for people by default, one JSON object per line where a machine reads them.

No line has a secret in it: traces come without the values of variables, headers that carry keys are named and not
shown, and whatever has the form of a key or of a password in an address is blotted out of the finished line.
"""

from __future__ import annotations

import asyncio
import logging
import re
import sys

import structlog

from service.clients import KEY_FORM
from service.repeats import Repeats
from service.settings import ServiceSettings

_HIDDEN = "…"
_SECRET_FIELDS = frozenset({"authorization", "cookie", "set-cookie", "key", "password", "proxy-authorization"})
_SECRET_HEADER = re.compile(
    r"(?i)\b((?:proxy-)?authorization|(?:set-)?cookie)(\W{1,8}(?:b['\"])?)(?:(?:bearer|basic) +)?[^\s'\",;)}\]]+"
)
_PASSWORD = re.compile(r"(\w://[^\s:/@]*:)[^\s/@]+@")
_LONGEST_TRACE = 20_000  # characters; the last ones say what happened


def without_secrets(line: str) -> str:
    """A line of a log with everything blotted out that could open something."""
    line = KEY_FORM.sub(rf"frd_\1_{_HIDDEN}", line)
    line = _SECRET_HEADER.sub(rf"\1\2{_HIDDEN}", line)
    return _PASSWORD.sub(rf"\1{_HIDDEN}@", line)


def _hide_fields(_logger: object, _name: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """Values whose names say that they are secret, whatever form they have."""
    return {name: _HIDDEN if name.lower() in _SECRET_FIELDS else value for name, value in event.items()}


def _trace(_logger: object, _name: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """A plain trace: with the values of variables it would show keys, and take seconds to write."""
    event = structlog.processors.format_exc_info(_logger, _name, event)
    trace = event.get("exception")
    if isinstance(trace, str) and len(trace) > _LONGEST_TRACE:
        event["exception"] = f"{trace[:1000]}\n  …\n{trace[-_LONGEST_TRACE:]}"
    return event


class _Blotted(logging.Formatter):
    """A formatter whose lines went through `without_secrets`."""

    def __init__(self, inner: logging.Formatter) -> None:
        super().__init__()
        self._inner = inner

    def format(self, record: logging.LogRecord) -> str:
        return without_secrets(self._inner.format(record))


def _is_told(record: logging.LogRecord) -> bool:
    """Requests that the end of the service cuts are no mistakes: a line each, without a trace."""
    if record.exc_info and isinstance(record.exc_info[1], asyncio.CancelledError):
        record.exc_info, record.msg, record.args = None, "a request was cut by the end of the service", None
    return True


def configure(settings: ServiceSettings) -> None:
    """Set up structlog for this process, and let the standard library's loggers end in the same lines."""
    level = logging.getLevelNamesMapping()[settings.log_level.upper()]
    shared: list[structlog.typing.Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso" if settings.log_json else "%H:%M:%S", utc=settings.log_json),
    ]
    shared += [_trace, _hide_fields]
    last: structlog.typing.Processor
    if settings.log_json:
        last = structlog.processors.JSONRenderer()
    else:
        last = structlog.dev.ConsoleRenderer(
            colors=sys.stderr.isatty(), exception_formatter=structlog.dev.plain_traceback
        )
    structlog.configure(
        processors=[*shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.stdlib.LoggerFactory(),
        cache_logger_on_first_use=False,
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(_is_told)
    handler.addFilter(Repeats())
    lines = structlog.stdlib.ProcessorFormatter(
        processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, last], foreign_pre_chain=shared
    )
    handler.setFormatter(_Blotted(lines))
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(level)
    # At every start it would say which database it found.
    logging.getLogger("alembic").setLevel(logging.WARNING)
    # Requests are not news; what they lead to is logged where it happens.
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access"):
        logging.getLogger(name).handlers = []
        logging.getLogger(name).propagate = True
        logging.getLogger(name).setLevel(logging.WARNING)
