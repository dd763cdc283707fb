"""Whether a request that changes something comes from a page of another site.

A browser sends what lets it in here by itself: the cookie, and on a service without keys its mere place on this
machine. So a page from anywhere, another port of this machine included, could use the service as if it were ours.
Enters: the head of a request. Leaves: why it is refused, or None. Reference: Fetch (Origin), W3C Fetch Metadata.
"""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.requests import Request

_READING = frozenset({"GET", "HEAD", "OPTIONS"})
_FORMS = frozenset({"application/x-www-form-urlencoded", "multipart/form-data", "text/plain"})
# No form can send these, and a script of another site only if we agreed to it (CORS), which we never do.
_NEVER_IN_FORMS = ("x-requested-with", "idempotency-key")
_PORTS = {"http": 80, "https": 443}
_PROXY = "behind a proxy that speaks TLS, name its address in FREDHOLM_TRUSTED_PROXIES"


def why_foreign(request: Request, are_keys_required: bool) -> str | None:
    """Why a request cannot be our own page's nor a program's; None if it can."""
    if request.method in _READING:
        return None
    headers = request.headers
    origin, site = headers.get("origin"), headers.get("sec-fetch-site")
    if site is not None and site not in ("same-origin", "none"):
        return f"Web pages of other sites ({site}) cannot change anything here; open the service's own page."
    if origin is not None:
        own = f"{request.url.scheme}://{headers.get('host', '')}"
        if _place(origin) is None or _place(origin) != _place(own):
            return (
                f"The request comes from a page of {origin[:100]!r}, and this is {own[:100]!r}: pages of other sites "
                f"cannot change anything here; open the service's own page, or, {_PROXY}."
            )
        return None
    if site is not None or (are_keys_required and "cookie" not in headers):
        return None  # nothing lets it in by itself
    if _could_be_a_form(request):
        return (
            "This could be a form of another web page: send the header X-Requested-With, or a body of the type "
            "application/json."
        )
    return None


def _could_be_a_form(request: Request) -> bool:
    """Whether a page of another site could have sent this from a browser that does not tell where it comes from."""
    headers = request.headers
    is_bearer = headers.get("authorization", "").lower().startswith("bearer ")
    if is_bearer or any(name in headers for name in _NEVER_IN_FORMS):
        return False
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind and kind not in _FORMS:
        return False
    # Forms have a type always and a browser's name; programs (curl -F, curl -X POST) send files and empty bodies.
    is_browser = headers.get("user-agent", "").startswith("Mozilla/")
    return is_browser or kind in _FORMS - {"multipart/form-data"}


def _place(origin: str) -> tuple[str, str, int] | None:
    """Scheme, host and port of an origin; None if it is none."""
    try:
        parts = urlsplit(origin)
        port = parts.port or _PORTS[parts.scheme]
    except (ValueError, KeyError):
        return None
    if not parts.hostname or parts.path or parts.query or parts.fragment or "@" in parts.netloc:
        return None
    return parts.scheme, parts.hostname, port
