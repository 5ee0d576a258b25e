"""Checks that the viewer is installed, and its errors."""

from __future__ import annotations

from importlib import import_module

from navloom.config import ConfigError
from navloom.errors import NavloomError

__all__ = ["ViewerError", "ViewerLost", "need_rerun"]


class ViewerError(ConfigError):
    """The viewer is not installed, does not start, or cannot be reached; the text says what to do."""


class ViewerLost(NavloomError):
    """The viewer failed while it showed a run: the request was valid and everything else has been done."""

    exit_code = 1


def need_rerun() -> None:
    """Raise ViewerError that names the extra to install if rerun is missing."""
    try:
        # Imported, not only looked for: an installation that does not load counts as missing.
        import_module("rerun")
    except ImportError:
        raise ViewerError(
            "the viewer needs the extra `view`: uv sync --group view, or pip install 'navloom[view]'"
        ) from None
