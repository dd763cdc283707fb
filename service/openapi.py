"""The API's description.

Adds what FastAPI cannot see: problem bodies, and messages inside streams and frames.
"""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic.json_schema import models_json_schema

from service.errors import MEDIA_TYPE
from service.messages import Deleted, FrameHeader, Hello, Job, Ping, Problem, ProgressMessage, Queue

_UNSEEN = (Problem, Hello, Job, Deleted, ProgressMessage, Queue, Ping, FrameHeader)
_PROBLEM = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}


def describe(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document of the app."""
    if app.openapi_schema:
        return app.openapi_schema
    document = get_openapi(title=app.title, version=app.version, summary=app.summary, routes=app.routes)
    schemas = document.setdefault("components", {}).setdefault("schemas", {})
    _, unseen = models_json_schema(
        [(model, "serialization") for model in _UNSEEN], ref_template="#/components/schemas/{model}"
    )
    schemas.update(unseen.get("$defs", {}))
    for methods in document["paths"].values():
        for operation in methods.values():
            if "requestBody" in operation:
                operation["responses"].setdefault("400", {"description": "The body cannot be read"})
                operation["responses"].setdefault("413", {"description": "The body is too large"})
            for status, answer in operation["responses"].items():
                is_readiness = "Readiness" in str(answer.get("content", ""))
                if status.startswith(("4", "5")) and not is_readiness:
                    answer["content"] = _PROBLEM
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    app.openapi_schema = document
    return document
