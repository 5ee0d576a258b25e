"""The line of a plugin's own code that an error came from, and the whole traceback on request."""

from __future__ import annotations

import os
import traceback
from pathlib import PurePath

from navloom.entry_kinds import TRACEBACK

__all__ = ["kept_tracebacks", "raised_in", "traceback_of", "whole_traceback"]

MOST = 64
"""Largest number of tracebacks that are kept."""
_KEPT: dict[str, str] = {}


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
    text = f"{type(error).__name__}: {error}{place}"
    if os.environ.get(TRACEBACK):
        _keep(text, error)
    return text


def _keep(text: str, error: BaseException) -> None:
    # Moved to the end: the newest of equal errors is the one in question.
    _KEPT.pop(text, None)
    _KEPT[text] = whole_traceback(error)
    if len(_KEPT) > MOST:
        del _KEPT[next(iter(_KEPT))]


def traceback_of(message: str) -> str:
    """The traceback that belongs to a message with an error's line; empty if none was kept."""
    # Messages are wrapped for terminals.
    flat = " ".join(message.split())
    return next((kept for text, kept in reversed(_KEPT.items()) if " ".join(text.split()) in flat), "")


def kept_tracebacks() -> dict[str, str]:
    """Kept tracebacks, by the one-line text of their error."""
    return dict(_KEPT)


def whole_traceback(error: BaseException) -> str:
    """A traceback with the whole chain of causes, also those that a clearer error suppresses."""
    seen: set[int] = set()
    one: BaseException | None = error
    while one is not None and id(one) not in seen:
        seen.add(id(one))
        # A clearer error hides its cause from users, but whoever asks for the traceback wants it.
        one.__suppress_context__ = one.__cause__ is not None
        one = one.__cause__ or one.__context__
    return "".join(traceback.format_exception(error))
