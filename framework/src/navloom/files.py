"""Files that are there whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

__all__ = ["write_each", "write_whole"]


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, or replace one: who reads it, or looks after a failure, finds the old contents or the new.

    Args:
        path: In a folder that exists.
        content: Text is written as UTF-8, its line ends as they are.

    Raises:
        OSError: It cannot be written, and names the path; nothing of it is left.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except BaseException as error:
        draft.unlink(missing_ok=True)
        if isinstance(error, OSError):  # a full disk names no file
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise


def write_each(folder: Path, files: Mapping[str, str | bytes]) -> dict[str, str]:
    """Write what can be written: on a full disk small files may still fit.

    Returns:
        Why a file is missing, by name; empty where all were written.
    """
    missing = {}
    for name, content in files.items():
        try:
            write_whole(folder / name, content)
        except OSError as error:
            missing[name] = error.strerror or str(error)
    return missing
