"""Where an estimate goes: the picture, and its checkpoint beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from renderer.errors import SettingsError
from renderer.estimate.estimate import Estimate
from service.command.arguments import check_is_exr


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """Where an estimate goes. picture: to be opened. checkpoint: with the moments; None where it is not wanted."""

    picture: Path
    checkpoint: Path | None
    half: bool = False

    def save(self, estimate: Estimate, stopped_by: str | None = None) -> None:
        """Writes both; the checkpoint first, so that no picture promises more than there is."""
        told = {"stopped_by": stopped_by or "checkpoint"}
        beside = self.checkpoint if self.checkpoint and _is_beside(self.checkpoint, self.picture) else None
        if self.checkpoint is not None:
            estimate.write(self.checkpoint, told)
        estimate.write_picture(self.picture, told, half=self.half, checkpoint=beside)


def output_files(output: Path, checkpoint: Path | None, no_checkpoint: bool = False, half: bool = False) -> OutputFiles:
    """The files to write. Raises SettingsError for names that cannot be."""
    check_is_exr(output)
    if checkpoint is not None:
        check_is_exr(checkpoint, "--checkpoint")
    if no_checkpoint and checkpoint is not None:
        raise SettingsError(f"--checkpoint is {checkpoint} and --no-checkpoint is given; give one or the other")
    if checkpoint is not None and checkpoint.resolve() == output.resolve():
        raise SettingsError(f"--checkpoint is {checkpoint}, as is --output; give them two names")
    beside = checkpoint or output.with_suffix(".checkpoint.exr")
    return OutputFiles(output, None if no_checkpoint else beside, half)


def _is_beside(path: Path, other: Path) -> bool:
    return path.resolve().parent == other.resolve().parent
