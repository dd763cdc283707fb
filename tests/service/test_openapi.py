"""schemathesis: requests made up from the API's own description. No 5xx, and answers are what the description says."""

from __future__ import annotations

import os

import httpx
import schemathesis
from hypothesis import HealthCheck, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from service_process import Server

from service.app import create_app
from service.settings import ServiceSettings

_SLOW = [HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large]
CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
EXAMPLES = int(os.environ.get("FREDHOLM_API_EXAMPLES", "8"))


# The API but its endless stream.
schema = schemathesis.openapi.from_dict(create_app(ServiceSettings()).openapi()).exclude(path="/api/events")


@schema.parametrize()
@settings(max_examples=EXAMPLES, deadline=None, derandomize=True, suppress_health_check=_SLOW)
def test_answers_are_as_described(case: schemathesis.Case, server: Server) -> None:
    response = case.call(base_url=server.url)
    try:
        case.validate_response(response, checks=CHECKS)
    finally:
        if case.method == "POST" and case.path == "/api/jobs" and response.status_code == 201:
            httpx.post(f"{server.url}/api/jobs/{response.json()['id']}/cancel")
