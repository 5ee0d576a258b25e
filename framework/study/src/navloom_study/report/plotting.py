"""Figures for print and screen: matplotlib without a display or global state, with reproducible bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

__all__ = ["MM", "new_figure", "pdf_of", "png_of", "styled", "svg_of"]

MM = 1.0 / 25.4
"""One millimetre in inches, matplotlib's unit."""
SALT = "navloom"
STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.3,
    "figure.constrained_layout.use": True,
    "path.simplify": True,
    "pdf.fonttype": 42,  # TrueType: publishers refuse the other kind
    "svg.fonttype": "path",
    "svg.hashsalt": SALT,
}


@contextmanager
def styled() -> Iterator[None]:
    """Apply navloom's style, as a decorator or within `with`; other users of matplotlib are not affected."""
    with rc_context(STYLE):
        yield


@styled()
def new_figure(width_mm: float, height_mm: float, rows: int = 1, columns: int = 1) -> tuple[Figure, Any]:
    """A figure in navloom's style, and its axes as `Figure.subplots` returns them: one, or an array.

    Draw where `styled()` applies, because matplotlib reads sizes of titles, legends and lines when it adds them.
    """
    figure = Figure(figsize=(width_mm * MM, height_mm * MM))
    return figure, figure.subplots(rows, columns)


@styled()
def svg_of(figure: Figure) -> str:
    """The figure as one `<svg>` element for a page: without prologue, reproducible.

    The remaining ids are content hashes, so that one page can contain several figures.
    """
    buffer = io.StringIO()
    # Not `savefig`, which draws twice, the first time for the layout alone: one drawing lays the figure out too.
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    return re.sub(r'<g id="[^"]*">', "<g>", text)


def pdf_of(figure: Figure) -> bytes:
    """The figure as a PDF file with reproducible bytes; its text stays text."""
    return _saved(figure, "pdf", metadata={"CreationDate": None, "Creator": None, "Producer": None})


def png_of(figure: Figure, dpi: int = 200) -> bytes:
    """The figure as a PNG file with reproducible bytes."""
    return _saved(figure, "png", dpi=dpi, metadata={"Software": None})


@styled()
def _saved(figure: Figure, kind: str, **options: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, **options)
    return buffer.getvalue()
