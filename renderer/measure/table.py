"""A measurement as tables for the terminal."""

from __future__ import annotations

import math

from rich.table import Table

from renderer.measure.result import BUDGETS, TARGETS, Measurement, Row, TimeTo


def settings_table(found: Measurement) -> Table:
    """One line per setting: speed, error with its interval, variance × time, and the time to each target."""
    table = Table(
        title=f"{found.scene}, {found.width}×{found.height}, {found.seconds:g} s each",
        caption=_caption(found),
        caption_justify="left",
        title_justify="left",
    )
    table.add_column("setting")
    columns = ["Msamples/s", "error", "95 %"]
    if found.reference:
        columns.append("true error")
    columns += ["variance × s", "efficiency", *(f"to {100 * t:g} %" for t in TARGETS)]
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    group = found.default.candidate.group
    for row in found.rows:
        if row.candidate.group != group:
            table.add_section()
            group = row.candidate.group
        table.add_row(*_cells(found, row), style="bold" if row is found.default else None)
    return table


def recommendations(found: Measurement) -> list[str]:
    """One sentence per budget."""
    lines = []
    for budget in BUDGETS:
        best = found.recommended(budget)
        if best is None:
            return ["None of the settings found any light in this time; give each more with --seconds."]
        line = f"{say_seconds(budget)}: {best.name}, about {percent(best.error_after(budget))} error"
        shallow = found.recommended(budget, allow_lost_light=True)
        if shallow is not None and shallow is not best:
            line += (
                f" (or {shallow.name}, about {percent(shallow.error_after(budget))}, "
                f"{percent(shallow.lost_light)} of the light left out)"
            )
        lines.append(line)
    return lines


def _cells(found: Measurement, row: Row) -> list[str]:
    last = row.last
    name = row.name
    if row.candidate.is_biased:
        name += f" (−{percent(max(0.0, row.lost_light))} light)"
    if last is None:
        blanks = ["–"] * (3 + bool(found.reference) + 1 + len(TARGETS))
        return [name, _millions(row), "not known yet" if row.share_found else "no light found", *blanks[1:]]
    mark = "" if row.is_trusted else "?"
    cells = [name, _millions(row), percent(last.error) + mark, f"{percent(last.low)}–{percent(last.high)}"]
    if found.reference:
        cells.append("–" if last.true_error is None else percent(last.true_error))
    cells += [f"{row.variance_time:.2e}", say_ratio(found, row)]
    return cells + [_time(row.time_to(target)) for target in TARGETS]


def say_ratio(found: Measurement, row: Row) -> str:
    """Efficiency over the default's with its 95 % interval, where that is known and does not hold 1."""
    if row is found.default:
        return "1"
    interval = found.efficiency_interval(row)
    if interval is None:
        return "not known yet"
    low, high = interval
    if low <= 1 <= high:
        return f"no difference seen ({_short(low)}–{_short(high)})"
    return f"{_short(found.relative_efficiency(row))} × ({_short(low)}–{_short(high)})"


def _short(ratio: float) -> str:
    return f"{ratio:.2f}" if ratio < 9.95 else f"{ratio:.0f}"


def _millions(row: Row) -> str:
    return "–" if math.isnan(row.samples_per_second) else f"{row.samples_per_second / 1e6:.2f}"


def _time(found: TimeTo | None) -> str:
    if found is None:
        return "never"
    return say_seconds(found.seconds) if found.is_measured else f"~{say_seconds(found.seconds)}"


def _caption(found: Measurement) -> str:
    notes = ["efficiency = 1 / (variance × seconds), as a multiple of the first line's, with 95 % interval; ~ forecast"]
    if any(not row.is_trusted for row in found.rows):
        notes.append("? most pixels' error bars cannot be believed yet: the true error may be far larger")
    if any(row.candidate.is_biased for row in found.rows):
        notes.append("a shallower depth leaves light out, and never gets below that error")
    if found.full_size > 1.05:
        notes.append(f"the scene's own size has {found.full_size:.1f} times the pixels, and takes that much longer")
    if found.reference:
        notes.append(f"true error: against {found.reference}")
    return "\n".join(notes)


def percent(fraction: float) -> str:
    """A fraction in per cent, two digits."""
    value = 100 * fraction
    if value >= 9.95:
        return f"{value:.0f} %"
    return f"{value:.1f} %" if value >= 0.95 else f"{value:.2g} %"


def say_seconds(seconds: float) -> str:
    """A duration, short."""
    if seconds < 0.995:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 99.5:
        return f"{seconds:.2g} s" if seconds < 9.95 else f"{seconds:.0f} s"
    if seconds < 5970:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.0f} h" if seconds < 360_000 else f"{seconds / 86_400:.0f} days"
