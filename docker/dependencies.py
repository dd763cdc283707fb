"""Prints what the package needs with its web server, the driver of PostgreSQL and a cluster, one requirement a line."""

from __future__ import annotations

import tomllib
from pathlib import Path

project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
needed = project["dependencies"] + extras["service"] + extras["postgres"] + extras["cluster"]
# An extra may name others of this package, which is not on any index while its image is built.
print("\n".join(line for line in needed if not line.startswith("fredholm[")))
