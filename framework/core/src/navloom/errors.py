"""Base class of navloom's errors."""

from __future__ import annotations

from typing import ClassVar

__all__ = ["NavloomError"]


class NavloomError(Exception):
    """Base of the errors that navloom raises for its users. The text is one message that needs no traceback.

    Attributes:
        exit_code: Exit code of the command line: 2 if the request was wrong, 1 if it was valid but failed.
    """

    exit_code: ClassVar[int] = 2
