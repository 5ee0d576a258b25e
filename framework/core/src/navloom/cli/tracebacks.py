"""`--traceback`: the whole traceback below the one message of an error."""

from __future__ import annotations

import os
from collections.abc import Mapping

from navloom.entry_kinds import TRACEBACK

__all__ = ["with_traceback", "with_traceback_of"]


def with_traceback(error: BaseException) -> Mapping[str, str]:
    """Extra of an error's log record: the traceback, if it was requested."""
    if not os.environ.get(TRACEBACK):
        return {}
    from navloom.plugins.error_origin import traceback_of, whole_traceback

    return {"traceback": traceback_of(str(error)) or whole_traceback(error)}


def with_traceback_of(message: str) -> Mapping[str, str]:
    """Extra of a log record whose message contains an error's text: its traceback, if it was requested."""
    if not os.environ.get(TRACEBACK):
        return {}
    from navloom.plugins.error_origin import traceback_of

    return {"traceback": traceback_of(message)}
