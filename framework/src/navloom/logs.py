"""Logging of the command line: what goes to standard error, from which level on, as text or as JSON lines.

Each house has a logger, `navloom.HOUSE`. A command sets up their common handler when it begins; a program that uses
navloom as a library sets up its own.
"""

from __future__ import annotations

import enum
import logging
import sys

__all__ = ["Level", "set_up_logging"]

ROOT = logging.getLogger("navloom")


class Level(enum.StrEnum):
    """Levels that can be asked for."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class TextFormatter(logging.Formatter):
    """The message, with `navloom: ` before each line; the traceback that a record carries follows as it is."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        told = record.getMessage()
        if record.exc_info:
            told = f"{told}\n{self.formatException(record.exc_info)}"
        lines = [f"navloom: {line}" for line in told.splitlines() or [""]]
        return "\n".join([*lines, *getattr(record, "traceback", "").splitlines()])


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time (Unix, s), level, logger, message, process, and the traceback where there is one."""

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
    """Writes to the standard error of the moment: above a line of progress where there is one."""

    def __init__(self) -> None:
        logging.Handler.__init__(self)

    @property
    def stream(self) -> object:
        """Where it goes."""
        return sys.stderr


def set_up_logging(level: Level, as_json: bool) -> None:
    """Log to standard error from a level on."""
    handler = StandardError()
    handler.setFormatter(JsonFormatter() if as_json else TextFormatter())
    ROOT.handlers = [handler]
    ROOT.setLevel(level.upper())
    ROOT.propagate = False
