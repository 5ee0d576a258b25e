"""What all errors of navloom have in common."""

from __future__ import annotations

from typing import ClassVar

__all__ = ["NavloomError"]


class NavloomError(Exception):
    """Base of the errors that navloom raises for its users. Its text is one message, and needs no traceback.

    Attributes:
        exit_code: Of the command line: 2 where the request was wrong, 1 where it was right and failed.
    """

    exit_code: ClassVar[int] = 2
