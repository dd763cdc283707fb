"""The promise that the page is light: what a browser loads before anything is asked of it."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import pytest

STATIC = Path(__file__).resolve().parents[2] / "service" / "static"
MOST_BYTES = 150_000  # compressed; chapters load when they are opened


def test_the_page_loads_little_at_first() -> None:
    if not (STATIC / "index.html").is_file():
        pytest.skip("the page is not built: make page")
    index = (STATIC / "index.html").read_text(encoding="utf-8")
    named = re.findall(r'(?:src|href)="\./([^"]+)"', index)
    assert any(name.endswith(".js") for name in named)
    first = {STATIC / "index.html", *(STATIC / name for name in named), *STATIC.glob("assets/*.worker-*.js")}
    assert sum(len(gzip.compress(path.read_bytes(), 9)) for path in first) <= MOST_BYTES
