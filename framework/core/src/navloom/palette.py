"""Colours with the same meaning in every picture."""

from __future__ import annotations

__all__ = ["GREY", "OKABE_ITO"]

OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
"""Colours of Okabe and Ito, suitable for any colour vision; pale yellow, hard to see on white, is last."""
GREY = "#8A8A8A"
"""Colour of background elements: grids, obstacles, zero lines."""
