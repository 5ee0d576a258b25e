"""Which line of a plugin's own code an error came from."""

from __future__ import annotations

import traceback
from pathlib import PurePath

__all__ = ["raised_in"]


def raised_in(error: BaseException, source: object) -> str:
    """An error in one line: its type, its text, and the innermost line of the plugin's own distribution.

    Args:
        error: What was raised.
        source: A class or function of the plugin, or the name of its module.
    """
    home = (source if isinstance(source, str) else getattr(source, "__module__", "")).partition(".")[0]
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__", "").partition(".")[0] == home:
            place = f" ({PurePath(frame.f_code.co_filename).name}:{line})"
    return f"{type(error).__name__}: {error}{place}"
