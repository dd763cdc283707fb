"""What to know before believing an image: samples that were not finite, pixels not to be trusted, light not seen."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderer.estimate.interval import MIN_REPLICATES
from renderer.estimate.moments import Moments

MAX_UNTRUSTED = 0.25  # share of pixels above which the image is called uncertain


@dataclass(frozen=True, slots=True)
class Health:
    """status: good, uncertain (many error bars cannot be believed yet, or some light cannot be seen, or hardly) or
    degraded (samples were not finite).

    invalid: samples that were not finite. invalid_pixels: pixels with such samples. empty_pixels: pixels that were
    sampled and have no finite sample at all. untrusted: share of pixels whose interval cannot be believed.
    needs_samples: samples per pixel from which error bars can be believed, where most pixels have fewer; else None.
    mixed: versions and kinds of device that rendered it, where there are several. cannot_see: light that the technique
    has no way to find. hidden: light that samples hardly ever meet, in sentences. warnings: what is odd about the
    scene.
    """

    status: str = "good"
    invalid: int = 0
    invalid_pixels: int = 0
    empty_pixels: int = 0
    untrusted: float = 0.0
    needs_samples: int | None = None
    mixed: tuple[str, ...] = ()
    cannot_see: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        lists = {"mixed": self.mixed, "cannot_see": self.cannot_see, "warnings": self.warnings, "hidden": self.hidden}
        return asdict(self) | {name: list(values) for name, values in lists.items()}

    def sentences(self) -> list[str]:
        """What to tell a person; nothing if all is well."""
        said = []
        if self.invalid:
            said.append(f"degraded: {self.invalid} samples in {self.invalid_pixels} pixels were not finite")
        if self.empty_pixels:
            said.append(f"degraded: {self.empty_pixels} pixels have no finite sample; they show as black")
        said += [f"incomplete: this technique cannot see the {what}" for what in self.cannot_see]
        said += [f"uncertain: {sentence}" for sentence in self.hidden]
        if self.untrusted > MAX_UNTRUSTED:
            what = f"{MIN_REPLICATES} replicates: {self.needs_samples} samples per pixel" if self.needs_samples else ""
            said.append(
                f"uncertain: {100 * self.untrusted:.0f} % of the pixels have error bars that cannot be believed yet; "
                + (f"that needs {what}" if what else "rendering longer helps")
            )
        if self.mixed:
            said.append(
                f"mixed: rendered by {' and by '.join(self.mixed)}; one estimate, but no straight run gives its bits"
            )
        return said + list(self.warnings)


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of an image beside its moments. warnings, cannot_see: of its scene and technique. hidden: told by
    its audit. made_with: versions and kinds of device.
    """

    warnings: tuple[str, ...] = ()
    cannot_see: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    made_with: tuple[str, ...] = ()


def examine(moments: Moments, trust: NDArray[np.bool_], replicate_size: int, known: Known) -> Health:
    """The health of an estimate. trust: whether each pixel's interval can be believed."""
    invalid = int(moments.invalid.sum())
    empty = int(((moments.tried > 0) & (moments.count == 0)).sum())
    untrusted = 1.0 - float(trust.mean())
    is_uncertain = untrusted > MAX_UNTRUSTED or bool(known.cannot_see) or bool(known.hidden)
    status = "degraded" if invalid or empty else "uncertain" if is_uncertain else "good"
    return Health(
        status=status,
        invalid=invalid,
        invalid_pixels=int((moments.invalid > 0).sum()),
        empty_pixels=empty,
        untrusted=untrusted,
        needs_samples=_needs_samples(moments, replicate_size),
        mixed=known.made_with if len(known.made_with) > 1 else (),
        cannot_see=known.cannot_see,
        warnings=known.warnings,
        hidden=known.hidden,
    )


def _needs_samples(moments: Moments, replicate_size: int) -> int | None:
    """Samples per pixel from which interval.trust can say anything, where it cannot for most pixels yet."""
    few = np.count_nonzero(moments.count < MIN_REPLICATES) > MAX_UNTRUSTED * len(moments.count)
    return MIN_REPLICATES * replicate_size if few else None
