"""Atomic writes, where a file exists whole or not at all, and folders to write to."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

__all__ = ["make_writable", "write_each", "write_whole"]


def make_writable(folder: Path) -> None:
    """Make a folder if it is missing, and try that files can be written there.

    Raises:
        OSError: They cannot.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=folder).close()


def write_whole(path: Path, content: str | bytes) -> None:
    """Write or replace a file atomically: readers find the old contents or the new, even after a failure.

    Args:
        path: File in an existing folder.
        content: Text is written as UTF-8 with its line ends unchanged.

    Raises:
        OSError: The file cannot be written. The error names the path; no partial file is left.
    """
    # In the same folder, since a rename across file systems is a copy; with the process ID, as two may write at once.
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            # Without it, a power cut after the rename leaves an empty file under the old name.
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException as error:
        draft.unlink(missing_ok=True)
        if isinstance(error, OSError):  # a full disk names no file
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def write_each(folder: Path, files: Mapping[str, str | bytes]) -> dict[str, str]:
    """Write as many of the files as possible: on a full disk small files may still fit.

    Returns:
        Reason for each missing file, by name; empty if all were written.
    """
    missing = {}
    for name, content in files.items():
        try:
            write_whole(folder / name, content)
        except OSError as error:
            missing[name] = error.strerror or str(error)
    return missing
