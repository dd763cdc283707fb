"""Serves the built page: files named after their content for ever, everything else always asked for again."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from service.access import COOKIE
from service.reference import page

_NOT_BUILT = page(
    "Fredholm",
    """<h1>The service runs, its page is not built</h1>
<p>Run <code>make run</code> in the project's folder: it builds the page and starts the service.
The API works without it: see <a href="docs">its documentation</a>.</p>""",
)


VIEWS = ("jobs", "learn")  # what the page shows stands after `#`; addresses are typed, and cut, without it


class Page(StaticFiles):
    """The folder of the page; a page that says how to build it while there is none."""

    def __init__(self, folder: Path, are_keys_required: bool = False) -> None:
        self._are_keys_required = are_keys_required
        super().__init__(directory=folder, html=True, check_dir=False)
        self._index = folder / "index.html"

    async def check_config(self) -> None:
        """Nothing: a folder that is not there is a page that is not built, not a mistake."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """One file of the page; the form for a key where the browser has none."""
        if self._are_keys_required and path in (".", "index.html") and COOKIE not in Request(scope).cookies:
            return RedirectResponse("login", status_code=303)
        if path in (".", "index.html") and not self._index.is_file():
            return HTMLResponse(_NOT_BUILT, headers={"Cache-Control": "no-cache"})
        if not self._index.is_file() and scope["method"] in ("GET", "HEAD"):
            raise HTTPException(404)
        if path.split("/")[0] in VIEWS and "text/html" in Request(scope).headers.get("accept", ""):
            return RedirectResponse(_with_hash(path, scope), status_code=307)
        response = await super().get_response(path, scope)
        is_hashed = path.startswith("assets/") and response.status_code in (200, 304)
        response.headers["Cache-Control"] = "public, max-age=31536000, immutable" if is_hashed else "no-cache"
        return response


def _with_hash(path: str, scope: Scope) -> str:
    """The address of a view, relative to where it was asked for, so that it holds behind a prefix as well."""
    depth = scope["path"].removeprefix(scope.get("root_path", "")).count("/") - 1
    query = scope["query_string"].decode("latin-1")
    return f"{'../' * depth or './'}#/{quote(path)}" + (f"?{query}" if query else "")
