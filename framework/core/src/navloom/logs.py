"""Logging of the command line to standard error, from a chosen level, as text or as JSON lines.

Each house has a logger, `navloom.HOUSE`. A command sets up their common handler at its start; a program that uses
navloom as a library sets up its own.
"""

from __future__ import annotations

import enum
import logging
import sys

from navloom.escapes import printable

__all__ = ["Level", "set_up_logging"]

ROOT = logging.getLogger("navloom")


class Level(enum.StrEnum):
    """Levels of `--log-level`."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class TextFormatter(logging.Formatter):
    """Formats a record as its message with `navloom: ` before each line; its traceback follows unchanged."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        told = printable(record.getMessage(), kept="\n\t")
        if record.exc_info:
            told = f"{told}\n{self.formatException(record.exc_info)}"
        lines = [f"navloom: {line}" for line in told.splitlines() or [""]]
        return "\n".join([*lines, *getattr(record, "traceback", "").splitlines()])


class JsonFormatter(logging.Formatter):
    """Formats a record as a JSON object on one line: time (Unix, s), level, logger, message, process, any traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        import json

        line = {
            "time": round(record.created, 6),
            "level": record.levelname.lower(),
            "logger": record.name,
            "process": record.process,
            "message": record.getMessage(),
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        if traceback := getattr(record, "traceback", ""):
            line["traceback"] = traceback
        return json.dumps(line, ensure_ascii=False)


class StandardError(logging.StreamHandler):  # type: ignore[type-arg]
    """Writes to the current `sys.stderr`, and so above a progress line if one is shown."""

    def __init__(self) -> None:
        logging.Handler.__init__(self)

    @property
    # Looked up each time: a progress display replaces `sys.stderr` for a while.
    def stream(self) -> object:
        """The current standard error."""
        return sys.stderr


def set_up_logging(level: Level, as_json: bool) -> None:
    """Log to standard error, from this level up."""
    handler = StandardError()
    handler.setFormatter(JsonFormatter() if as_json else TextFormatter())
    ROOT.handlers = [handler]
    ROOT.setLevel(level.upper())
    # A handler of the root logger would print each line twice.
    ROOT.propagate = False
