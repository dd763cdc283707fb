"""How long a turn may take, and what follows from one that was lost."""

from __future__ import annotations

from service.crashes import failure_of_losses, turn_deadline
from service.engine.interface import Lost


def test_a_lost_turn_never_lengthens_the_next() -> None:
    assert turn_deadline(120, None) == 120
    assert turn_deadline(120, 0.3) == 120, "its scene may have to be compiled again"
    assert turn_deadline(120, 20) == 200
    assert turn_deadline(120, 1e6) == 360, "however long turns have been"


def test_a_job_that_hangs_fails_with_a_way_out() -> None:
    lost = Lost("the render process gave no answer within 120 s")
    assert failure_of_losses(2, 3, lost) is None
    failure = failure_of_losses(3, 3, lost)
    assert failure is not None
    assert "tried 3 times" in failure.detail
    assert "max_depth" in failure.hint
