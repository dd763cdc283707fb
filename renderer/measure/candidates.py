"""Which settings are worth comparing on a scene: the default, and what differs from it in one respect."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from renderer.settings import DEFAULT_REPLICATE_SIZE, TECHNIQUES, Settings

REPLICATE_SIZES = (1, 4, 16, 64)
DEPTHS = (2, 3, 5, 9, 17)
MOST_DEPTHS = 3
DEFAULT = "default"


@dataclass(frozen=True, slots=True)
class Candidate:
    """Settings with a short name. group: what they differ in: default, technique, replicate size, sampling or depth."""

    name: str
    group: str
    settings: Settings

    @property
    def is_biased(self) -> bool:
        """Whether these settings estimate less light than is there: paths cut short."""
        return self.group == "depth"


def candidates(settings: Settings, max_depth: int, techniques_only: bool = False) -> tuple[Candidate, ...]:
    """The default first, then one change at a time.

    settings: what all share. max_depth: of the scene, −1 = unlimited; shallower depths are tried.
    """
    base = replace(settings, replicate_size=settings.replicate_size or DEFAULT_REPLICATE_SIZE)
    found = [Candidate(_name_of(base), DEFAULT, base)]
    found += [Candidate(t, "technique", replace(base, technique=t)) for t in TECHNIQUES if t != base.technique]
    if techniques_only:
        return tuple(found)
    found += [
        Candidate(f"replicates of {size}", "replicate size", replace(base, replicate_size=size))
        for size in REPLICATE_SIZES
        if size != base.replicate_size
    ]
    if any(f.name == "adaptive" for f in fields(Settings)):
        is_adaptive = bool(getattr(base, "adaptive", False))
        other = "even sampling" if is_adaptive else "adaptive sampling"
        found.append(Candidate(other, "sampling", replace(base, **{"adaptive": not is_adaptive})))
    shallower = [d for d in DEPTHS if max_depth < 0 or d < max_depth]
    found += [Candidate(f"depth {d}", "depth", replace(base, max_depth=d)) for d in shallower[-MOST_DEPTHS:]]
    return tuple(found)


def _name_of(base: Settings) -> str:
    return f"{base.technique}, replicates of {base.replicate_size}"
