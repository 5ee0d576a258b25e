"""Keeps the output of a plugin apart from the reports of its process."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from typing import IO

__all__ = ["PRINTED", "Printed"]


class Printed:
    """Standard output of this process, in a file from `capture` on."""

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None
        self._seen = 0

    def capture(self) -> None:
        """Redirect standard output, also that of C code, to a file that is deleted with the process."""
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  (open as long as the process)
        sys.stdout.flush()
        os.dup2(self._file.fileno(), 1)

    def news(self) -> str:
        """The first 4096 bytes that were printed since the last call."""
        if self._file is None:
            return ""
        sys.stdout.flush()
        size = os.fstat(self._file.fileno()).st_size
        text = os.pread(self._file.fileno(), min(size - self._seen, 4096), self._seen).decode(errors="replace")
        self._seen = size
        return text

    def errors(self) -> int:
        """Lines on standard error so far; 0 if it is not a file, as it is in the process of `navloom check`."""
        sys.stderr.flush()
        if not stat.S_ISREG(os.fstat(2).st_mode):
            return 0
        with open("/proc/self/fd/2", "rb") as file:
            return sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b""))


PRINTED = Printed()
"""Standard output of this process."""
