"""A measurement as an SVG chart: error over time, one panel per kind of setting, the default in each of them.

Both axes are logarithmic, so that Monte Carlo is a straight line that falls by one half; the parallel hairlines show
that slope, and a setting that lies one hairline lower needs a quarter of the time. Bands are 95 % intervals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

from renderer.measure.result import TARGETS, Measurement, Point, Row
from renderer.measure.table import percent, say_seconds

PLOT_WIDTH, PLOT_HEIGHT = 330, 300
LABELS = 176  # to the right of each panel, for the names of its lines
LEFT, TOP, BOTTOM, GAP, MARGIN = 52, 104, 90, 22, 28
MOST_COLUMNS = 2
LINE = 15  # least distance of two labels
INK, MUTED, GRID, PAPER, ACCENT = "#1f2430", "#6b7280", "#e6e8ec", "#ffffff", "#2f5bea"
COLOURS = ("#d9480f", "#2b8a3e", "#9c36b5", "#c2255c", "#0b7285")
TITLES = {
    "technique": "Technique",
    "replicate size": "Replicate size",
    "sampling": "Where samples go",
    "depth": "Path depth",
}


@dataclass(frozen=True)
class _Axes:
    """Logarithmic scales shared by all panels. Values outside are cut off by the panel's frame."""

    seconds: tuple[float, float]
    error: tuple[float, float]

    def x(self, seconds: float) -> float:
        low, high = map(math.log, self.seconds)
        return PLOT_WIDTH * (math.log(seconds) - low) / (high - low)

    def y(self, error: float) -> float:
        low, high = map(math.log, self.error)
        return PLOT_HEIGHT * (high - math.log(max(error, 1e-12))) / (high - low)


def svg(found: Measurement) -> str:
    """The chart as an SVG document, or one that says that no light was found."""
    groups = list(dict.fromkeys(row.candidate.group for row in found.rows[1:])) or [found.default.candidate.group]
    columns, rows_of_panels = min(len(groups), MOST_COLUMNS), -(-len(groups) // MOST_COLUMNS)
    across, down = LEFT + PLOT_WIDTH + LABELS + GAP, PLOT_HEIGHT + BOTTOM
    width = 2 * MARGIN + columns * across - GAP
    height = TOP + rows_of_panels * down
    drawn = [row for row in found.rows if row.curve]
    body = [_text(MARGIN, 38, f"{found.scene}: error over time", 20, INK, weight=600)]
    if not drawn:
        body.append(_text(MARGIN, TOP, "none of the settings found any light in this time", 14, MUTED))
        return _document(width, height, body)
    truth = f"; dotted: true error against {found.reference}" if found.reference else ""
    subtitle = (
        f"{found.width}×{found.height} pixels, {found.seconds:g} s each, taking turns; "
        f"×: efficiency, 1/(variance × s), over the default's, 95 % interval; ?: not known yet{truth}"
    )
    body.append(_text(MARGIN, 60, subtitle, 11, MUTED))  # a single panel is no wider than this line
    axes = _axes(drawn)
    for i, group in enumerate(groups):
        rows = [row for row in found.rows if row.candidate.group == group or row is found.default]
        left, top = MARGIN + i % MOST_COLUMNS * across + LEFT, TOP + i // MOST_COLUMNS * down
        body.append(f'<g transform="translate({left},{top})">{_panel(found, group, rows, axes, i)}</g>')
    return _document(width, height, body)


def _axes(rows: list[Row]) -> _Axes:
    points = [point for row in rows for point in row.curve]
    low = min(0.7 * min(p.seconds for p in points), 0.1)
    seconds = (max(low, 0.01), 1.15 * max(p.seconds for p in points))
    errors = sorted(e for p in points for e in (p.error, p.true_error) if e)
    high = min(max(errors) * 1.3, 30 * errors[0] * 10)
    return _Axes(seconds, (min(errors[0] * 0.75, high / 4), high))


def _panel(found: Measurement, group: str, rows: list[Row], axes: _Axes, index: int) -> str:
    clip = f"panel-{index}"
    parts = [
        _text(0, -16, TITLES.get(group, group.capitalize()), 14, INK, weight=600),
        f'<clipPath id="{clip}"><rect width="{PLOT_WIDTH}" height="{PLOT_HEIGHT}"/></clipPath>',
        _grid(axes),
        f'<g clip-path="url(#{clip})">',
    ]
    labels: list[tuple[float, float, str, str, bool]] = []
    colours = dict(zip([r.name for r in rows if r is not found.default], COLOURS, strict=False))
    for row in sorted(rows, key=lambda r: r is found.default):  # the default on top
        colour = ACCENT if row is found.default else colours.get(row.name, MUTED)
        if not row.curve:
            why = "not known yet" if row.share_found else "no light found"
            labels.append((PLOT_HEIGHT, PLOT_WIDTH, f"{row.name}: {why}", MUTED, False))
            continue
        parts.append(_curve(row, axes, colour, row is found.default))
        end = min(max(axes.y(row.curve[-1].error), 0), PLOT_HEIGHT)
        labels.append((end, axes.x(row.curve[-1].seconds), _label(found, row), colour, row is found.default))
    parts.append("</g>")
    parts += _labels(labels)
    return "".join(parts)


def _grid(axes: _Axes) -> str:
    parts = []
    for seconds in _round_numbers(*axes.seconds):
        x = axes.x(seconds)
        parts.append(f'<path d="M{x:.1f} 0V{PLOT_HEIGHT}" stroke="{GRID}"/>')
        parts.append(_text(x, PLOT_HEIGHT + 18, say_seconds(seconds), 11, MUTED, anchor="middle"))
    parts.append(_text(PLOT_WIDTH / 2, PLOT_HEIGHT + 40, "render time", 11, MUTED, anchor="middle"))
    for error in _round_numbers(*axes.error):
        y = axes.y(error)
        parts.append(f'<path d="M0 {y:.1f}H{PLOT_WIDTH}" stroke="{GRID}"/>')
        parts.append(_text(-8, y + 4, percent(error), 11, INK if error in TARGETS else MUTED, anchor="end"))
    # The slope of Monte Carlo, 1/√n, every factor of two.
    start, end = axes.seconds
    error = axes.error[0] / 64
    lines = []
    while error < axes.error[1] * math.sqrt(end / start):
        right = error * math.sqrt(start / end)
        lines.append(f"M0 {axes.y(error):.1f}L{PLOT_WIDTH} {axes.y(right):.1f}")
        error *= 2
    slopes = f'<path d="{"".join(lines)}" stroke="{MUTED}" stroke-opacity=".28" stroke-width=".7" fill="none"/>'
    parts.append(f'<svg width="{PLOT_WIDTH}" height="{PLOT_HEIGHT}" overflow="hidden">{slopes}</svg>')
    parts.append(f'<path d="M0 0V{PLOT_HEIGHT}H{PLOT_WIDTH}" stroke="{MUTED}" fill="none"/>')
    return "".join(parts)


def _curve(row: Row, axes: _Axes, colour: str, is_default: bool) -> str:
    def line(points: list[tuple[float, float]]) -> str:
        return "M" + "L".join(f"{axes.x(s):.1f} {axes.y(e):.1f}" for s, e in points)

    upper = [(p.seconds, p.high) for p in row.curve]
    lower = [(p.seconds, p.low) for p in reversed(row.curve)]
    middle = [(p.seconds, p.error) for p in row.curve]
    parts = [f'<path d="{line(upper + lower)}Z" fill="{colour}" fill-opacity=".13"/>']
    thickness = 2.6 if is_default else 1.7
    dash = "" if row.is_trusted else ' stroke-dasharray="6 4"'
    parts.append(
        f'<path d="{line(middle)}" fill="none" stroke="{colour}" stroke-width="{thickness}" stroke-linejoin="round"'
        f"{dash}><title>{escape(row.name)}</title></path>"
    )
    true = [(p.seconds, p.true_error) for p in row.curve if p.true_error]
    if true:
        parts.append(f'<path d="{line(true)}" fill="none" stroke="{colour}" stroke-width="1.6" stroke-dasharray="1 4"')
        parts[-1] += ' stroke-linecap="round"/>'
    end: Point = row.curve[-1]
    parts.append(f'<circle cx="{axes.x(end.seconds):.1f}" cy="{axes.y(end.error):.1f}" r="3" fill="{colour}"/>')
    return "".join(parts)


def _label(found: Measurement, row: Row) -> str:
    if row is found.default:
        return row.name
    light = f", −{percent(max(0.0, row.lost_light))} light" if row.candidate.is_biased else ""
    interval = found.efficiency_interval(row)
    if interval is None:
        return f"{row.name} ?{light}"
    low, high = interval
    said = "no difference" if low <= 1 <= high else f"{low:.2g}–{high:.2g} ×"
    return f"{row.name}: {said}{light}"


def _labels(labels: list[tuple[float, float, str, str, bool]]) -> list[str]:
    """Names beside the ends of their lines, pushed apart where they would touch."""
    ordered = sorted(labels)
    heights = [y for y, *_ in ordered]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + LINE)
    overflow = max(0.0, heights[-1] - PLOT_HEIGHT) if heights else 0.0
    for i in range(len(heights) - 1, -1, -1):
        ceiling = PLOT_HEIGHT if i == len(heights) - 1 else heights[i + 1] - LINE
        heights[i] = min(heights[i], ceiling) if overflow else heights[i]
    parts = []
    for y, (line_end, start, name, colour, is_default) in zip(heights, ordered, strict=True):
        x = PLOT_WIDTH + 5
        parts.append(
            f'<path d="M{start + 5:.1f} {line_end:.1f}H{PLOT_WIDTH}L{x + 5} {y:.1f}" stroke="{colour}" '
            'stroke-opacity=".45" fill="none"/>'
        )
        parts.append(_text(x + 9, y + 4, name, 11.5, colour, weight=600 if is_default else 400))
    return parts


def _round_numbers(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten between two limits; powers alone where those would crowd."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if math.log10(high / low) < 2.2 else (1,)
    return [v for d in decades for s in steps if low <= (v := float(f"{s}e{d}")) <= high]


def _text(x: float, y: float, text: str, size: float, colour: str, weight: int = 400, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{colour}" font-weight="{weight}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )


def _document(width: float, height: float, body: list[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" '
        f'height="{height:.0f}" font-family="Inter, system-ui, -apple-system, Segoe UI, Helvetica, Arial, sans-serif">'
        f'<rect width="100%" height="100%" fill="{PAPER}"/>{"".join(body)}</svg>\n'
    )
