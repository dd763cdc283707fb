"""Fredholm under its own name: `import fredholm` offers what `import renderer` does, the same objects.

    import fredholm
    estimate = fredholm.render("cornell-box", fredholm.Target(error=0.05))

`fredholm.client` speaks to a service (extra `service`).
"""

import sys
from importlib.metadata import PackageNotFoundError, version

from renderer import *  # noqa: F403
from renderer import __all__ as __all__
from renderer import errors

sys.modules["fredholm.errors"] = errors  # for `from fredholm.errors import SceneError`

try:
    __version__ = version("fredholm")
except PackageNotFoundError:  # a source tree that is on the path without having been installed
    __version__ = "unknown"
