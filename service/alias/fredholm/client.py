"""A client of the service: `from fredholm.client import Client`. It needs the extra `service`."""

from service.extras import explained

with explained("fredholm.client"):
    from service.client import Client, ServiceError, ServiceUnreachable

__all__ = ["Client", "ServiceError", "ServiceUnreachable"]
