"""Size bounds of input files, and bounded reading.

`NAVLOOM_MAX_INPUT_MB` replaces every bound in MB below. Properties other than size, such as nesting, have fixed bounds.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from gzip import GzipFile

__all__ = [
    "ARRAYS_MB", "BAG_MB", "CHUNK_MB", "DEEPEST", "IMAGE_MB", "LOG_MB", "TEXT_MB", "VARIABLE", "YAML_MB", "Refusal",
    "bytes_of", "open_file", "read_file", "read_past", "too_large",
]  # fmt: skip

VARIABLE = "NAVLOOM_MAX_INPUT_MB"
"""Environment variable that replaces every bound in MB."""
YAML_MB = 0.25
"""Bound of a YAML file, MB; the parser takes 1 s for about 100 kB."""
TEXT_MB = 16.0
"""Bound of a text that is parsed into objects (TOML, JSON, CSV, PEM), MB."""
ARRAYS_MB = 256.0
"""Bound of an `.npz` file, and of its numbers unpacked as float64, MB."""
IMAGE_MB = 512.0
"""Bound of a map, image or journal file, packed and unpacked, MB."""
CHUNK_MB = 512.0
"""Bound of an unpacked chunk of a recording, MB."""
BAG_MB = 1024.0
"""Bound of the memory for reading a ROS bag, and of its unpacked files on disk, MB."""
LOG_MB = 512.0
"""Bound of a text log that is read line by line, packed and unpacked, MB."""
DEEPEST = 64
"""Deepest nesting of TOML, JSON and YAML, and most parts of a dotted key. Fixed: a robot's config needs 5."""

Refusal = Callable[[str], Exception]
"""Makes the caller's error from a text."""

_KINDS = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


def bytes_of(megabytes: float, refusal: Refusal) -> int:
    """A bound, bytes, from the environment variable if it is set.

    Args:
        megabytes: The bound if the variable is not set, MB.
        refusal: Makes the error for a value that is not a number > 0.
    """
    given = os.environ.get(VARIABLE, "")
    if not given:
        return round(megabytes * 1e6)
    try:
        wanted = float(given)
    except ValueError:
        wanted = 0.0
    if not 0.0 < wanted < 1e9:
        raise refusal(f"{VARIABLE}={given[:40]}: expected a number of MB > 0, as in {VARIABLE}=2000")
    return round(wanted * 1e6)


def too_large(what: str, limit: int) -> str:
    """Error text for something larger than its bound.

    Args:
        what: The place and the size, as "F.npz: unpacks to 4000 MB".
        limit: The bound, bytes.
    """
    return f"{what}, expected at most {limit / 1e6:g} MB; set {VARIABLE} to read more"


def open_file(path: Path, refusal: Refusal) -> BinaryIO:
    """A file opened for reading. Other kinds are refused: a pipe may block forever, a device may be endless.

    Raises:
        OSError: The file is missing, a folder, or not readable.
    """
    # Opened first and looked at by its descriptor: the file behind the path may be replaced in between.
    number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    mode = os.fstat(number).st_mode
    if not stat.S_ISREG(mode):
        os.close(number)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        kind = next((name for fits, name in _KINDS if fits(mode)), "no file")
        raise refusal(f"{path}: is {kind}, expected a file")
    return os.fdopen(number, "rb")


def read_file(path: Path, megabytes: float, refusal: Refusal) -> bytes:
    """The contents of a file within a bound; a file that grows in the meantime is read up to the bound.

    Args:
        path: The file.
        megabytes: The bound, MB.
        refusal: Makes the error for a larger file, or for something other than a file.

    Raises:
        OSError: The file is missing or cannot be read.
    """
    limit = bytes_of(megabytes, refusal)
    with open_file(path, refusal) as file:
        size = os.fstat(file.fileno()).st_size
        content = read_past(file, limit, size + 1) if size <= limit else b""
    if size > limit or len(content) > limit:
        raise refusal(too_large(f"{path}: {max(size, len(content)) / 1e6:.6g} MB", limit))
    return content


def read_past(file: BinaryIO | GzipFile, limit: int, first: int = 1_000_000) -> bytes:
    """A stream's content, and at most one byte more than `limit`, which shows that it has more.

    It is read in blocks: one read reserves memory for all that it asks for, however little there is.

    Args:
        file: The stream.
        limit: Bytes.
        first: Size of the first block, bytes; with all in it, nothing is copied.
    """
    content = file.read(min(first, limit + 1))
    while len(content) <= limit and (block := file.read(min(max(len(content), 1), limit + 1 - len(content)))):
        content += block
    return content
