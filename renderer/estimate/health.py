"""What to know before believing an image: samples that were not finite, pixels not to be trusted, light not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from renderer.estimate.estimate import Estimate

MAX_UNTRUSTED = 0.25  # share of pixels above which the image is called uncertain


@dataclass(frozen=True, slots=True)
class Health:
    """status: good, uncertain (many error bars cannot be believed yet, or some light cannot be seen) or
    degraded (samples were not finite).

    invalid: samples that were not finite. invalid_pixels: pixels with such samples. empty_pixels: pixels that were
    sampled and have no finite sample at all. untrusted: share of pixels whose interval cannot be believed.
    cannot_see: light that the technique has no way to find. warnings: what is odd about the scene.
    """

    status: str = "good"
    invalid: int = 0
    invalid_pixels: int = 0
    empty_pixels: int = 0
    untrusted: float = 0.0
    cannot_see: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files and messages."""
        return asdict(self) | {"cannot_see": list(self.cannot_see), "warnings": list(self.warnings)}

    def sentences(self) -> list[str]:
        """What to tell a person; nothing if all is well."""
        said = []
        if self.invalid:
            said.append(f"degraded: {self.invalid} samples in {self.invalid_pixels} pixels were not finite")
        if self.empty_pixels:
            said.append(f"degraded: {self.empty_pixels} pixels have no finite sample; they show as black")
        said += [f"incomplete: this technique cannot see the {what}" for what in self.cannot_see]
        if self.untrusted > MAX_UNTRUSTED:
            said.append(
                f"uncertain: {100 * self.untrusted:.0f} % of the pixels have error bars that cannot be believed yet; "
                "rendering longer helps"
            )
        return said + list(self.warnings)


def examine(estimate: Estimate, warnings: Sequence[str] = (), cannot_see: Sequence[str] = ()) -> Health:
    """The health of an estimate. warnings, cannot_see: what is known of its scene and technique."""
    moments = estimate.moments
    invalid = int(moments.invalid.sum())
    empty = int(((moments.tried > 0) & (moments.count == 0)).sum())
    untrusted = 1.0 - float(estimate.trust.mean())
    status = "degraded" if invalid or empty else "uncertain" if untrusted > MAX_UNTRUSTED or cannot_see else "good"
    return Health(
        status=status,
        invalid=invalid,
        invalid_pixels=int((moments.invalid > 0).sum()),
        empty_pixels=empty,
        untrusted=untrusted,
        cannot_see=tuple(cannot_see),
        warnings=tuple(warnings),
    )
