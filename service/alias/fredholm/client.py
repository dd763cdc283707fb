"""Clients of a service: `from fredholm.client import Client, AsyncClient`. They need the extra `service`."""

from service.extras import explained

with explained("fredholm.client"):
    from service.async_client import AsyncClient
    from service.client import Client, ServiceError, ServiceUnreachable

__all__ = ["AsyncClient", "Client", "ServiceError", "ServiceUnreachable"]
