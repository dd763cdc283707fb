"""What all commands share with the terminal: messages, progress, exit codes, and how they are stopped."""

from __future__ import annotations

import signal
from pathlib import Path
from types import FrameType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

err = Console(stderr=True)


def say(text: str, style: str | None = None) -> None:
    """A sentence on standard error, as it is."""
    err.print(text, style=style, highlight=False, markup=False, soft_wrap=True)


def say_seconds(seconds: float) -> str:
    """A duration as people say it."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


class Stop:
    """Ctrl-C and SIGTERM, taken over: the first asks to stop, the second leaves."""

    def __init__(self) -> None:
        self._is_asked = False
        signal.signal(signal.SIGINT, self._on_signal)
        signal.signal(signal.SIGTERM, self._on_signal)

    def is_asked(self) -> bool:
        """Whether to stop at the next good moment."""
        return self._is_asked

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._is_asked:
            raise KeyboardInterrupt
        self._is_asked = True
        err.print("\nStopping after this pass; Ctrl-C again to leave without saving.")


def progress_bar() -> Progress:
    """A bar on standard error, where that is a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(bar_width=30), TextColumn("{task.detail}"))
    return Progress(*columns, console=err, disable=not err.is_terminal)


def title(scene: str) -> str:
    """What a scene is called while it is worked on."""
    path = Path(scene)
    return path.parent.name if path.stem == "scene" else path.stem
