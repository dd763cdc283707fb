"""axe on every place of the page: no violation, and nothing that axe could not decide."""

from __future__ import annotations

import json
from itertools import cycle
from pathlib import Path

import pytest
from places import PLACES, Stage, remember_theme
from playwright.sync_api import Page
from running import ROOT

AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
LOOKS = [(1440, "dark"), (420, "light"), (900, "dark"), (1440, "light"), (420, "dark"), (900, "light")]
# By default places that differ most, each in a look of its own turn; `slow` asks for all looks of all places.
DEFAULT = "empty new-chosen new-wrong refused queued no-frame-yet running doubtful failed reconnecting error wipe side "
DEFAULT += "difference region reference opened colours layers help continue menu"
BY_DEFAULT = [(name, *look) for name, look in zip(DEFAULT.split(), cycle(LOOKS), strict=False)]
OTHERS = [(name, *look) for name in PLACES for look in LOOKS if (name, *look) not in BY_DEFAULT]


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not installed: python hatch_build.py installs it")
@pytest.mark.parametrize(
    ("name", "width", "theme"), [*BY_DEFAULT, *(pytest.param(*other, marks=pytest.mark.slow) for other in OTHERS)]
)
def test_axe_finds_nothing(page: Page, stage: Stage, name: str, width: int, theme: str) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    remember_theme(page, theme)
    PLACES[name](page, stage)
    assert axe_findings(page, AXE) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width, "something sticks out to the right"


def axe_findings(page: Page, script: Path) -> list[str]:
    """Violations, and what axe could not decide, one line each."""
    page.evaluate(script.read_text(encoding="utf-8"))
    report = page.evaluate("axe.run(document, { resultTypes: ['violations', 'incomplete'] })")
    return [
        f"{kind} {rule['id']}: {node['html'][:160]} {json.dumps(node['any'][:1])[:300]}"
        for kind in ("violations", "incomplete")
        for rule in report[kind]
        for node in rule["nodes"]
    ]
