"""An estimate as a notebook shows it: the picture, its error and what to know before believing it, in one card."""

from __future__ import annotations

from base64 import b64encode
from html import escape

from renderer.estimate.contents import Contents
from renderer.image.png import encode_png

LONGEST_SIDE = 1024  # pixels of the picture in a card: notebooks keep them
SMALLEST_SHOWN = 128  # to which pictures of few pixels are enlarged, with their pixels as squares
_CARD = (
    "display:inline-block;border:1px solid #8888;border-radius:6px;padding:10px;font-family:sans-serif;font-size:13px"
)


def png(estimate: Contents) -> bytes:
    """The picture, its longest side reduced to LONGEST_SIDE by leaving out pixels."""
    step = -(-max(estimate.width, estimate.height) // LONGEST_SIDE)
    return encode_png(estimate.picture()[::step, ::step])


def error_sentence(estimate: Contents) -> str:
    """The error of the whole picture with the bound that holds with 95 %, or why it is not known."""
    found = estimate.image_error
    if found.error is None:
        return found.unknown or "not known"
    said = f"{100 * found.error:.3g} %"
    return said if found.upper is None else f"{said}, below {100 * found.upper:.3g} % with 95 % confidence"


def trust_sentence(estimate: Contents) -> str:
    """The share of pixels whose error bars can be believed, and the health."""
    return f"{100 * float(estimate.trust.mean()):.1f} % of the pixels have error bars that can be believed"


def html(estimate: Contents) -> str:
    """The card. Names and warnings come from scenes and are escaped."""
    rows = {
        "Relative error": error_sentence(estimate),
        "Trust": trust_sentence(estimate),
        "Health": estimate.health.status,
        "Samples": f"{estimate.spp:.4g} per pixel, seed {', '.join(str(seed) for seed, _ in estimate.ranges)}",
        "Time": f"{estimate.seconds:.3g} s",
    }
    title = f"{estimate.identity.scene_name}, {estimate.width} × {estimate.height}"
    shown = max(min(estimate.width, LONGEST_SIDE), SMALLEST_SHOWN)
    picture = b64encode(png(estimate)).decode("ascii")
    cells = "".join(
        f"<tr><th style='text-align:left;padding:2px 12px 2px 0'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    notes = "".join(f"<li>{escape(sentence)}</li>" for sentence in estimate.health.sentences())
    return (
        f"<div style='{_CARD}'><b>{escape(title)}</b><br>"
        f"<img alt='{escape(title)}' width='{shown}' style='max-width:100%;image-rendering:pixelated;margin:8px 0' "
        f"src='data:image/png;base64,{picture}'>"
        f"<table>{cells}</table>{f'<ul>{notes}</ul>' if notes else ''}</div>"
    )
