"""Errors of worlds and their files, and file access that raises only these."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from urllib.parse import parse_qsl

from navloom.errors import NavloomError
from navloom.inputs.bounds import read_file

__all__ = ["WorldError", "did_you_mean", "file_of", "options_of", "read_bytes", "readable"]


_SHOWN = 30
"""Most names that an error lists."""


class WorldError(NavloomError, ValueError):
    """A world cannot be made; the text names the file and place, the given value and the expectation."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`did you mean 'x'?` with the known name closest to a wrong one, or the list of known names if none is close."""
    names = sorted(known)
    close = get_close_matches(name, names, n=1, cutoff=0.6)
    if close:
        return f"did you mean {close[0]!r}?"
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"known are {', '.join(names[:_SHOWN])}{more}" if names else "none is known"


def file_of(text: str, base: Path) -> Path:
    """The file a reference names, relative to a base folder.

    Raises:
        WorldError: The text is empty or not a file name.
    """
    # For a null character the file system functions raise a ValueError, not the OSError that is caught later.
    if not text.strip() or "\0" in text:
        raise WorldError(f"file name {text!r}: expected the name of a file")
    return base / text


def options_of(argument: str, defaults: dict[str, str]) -> tuple[str, dict[str, str]]:
    """Split `file?key=value&key=value` into the file and its options.

    Args:
        argument: Text after the scheme's colon.
        defaults: Valid options with their defaults.

    Raises:
        WorldError: An option is unknown or has no value.
    """
    name, question, query = argument.partition("?")
    options = dict(defaults)
    if question:
        try:
            # Not strict, it drops a part without `=` silently.
            pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True)
        except ValueError:
            raise WorldError(f"{argument!r}: expected options as ?key=value&key=value after the file name") from None
        for key, value in pairs:
            if key not in defaults:
                raise WorldError(f"{argument!r}: option {key!r} does not exist; {did_you_mean(key, defaults)}")
            options[key] = value
    return name, options


def read_bytes(path: Path, megabytes: float) -> bytes:
    """The contents of a file.

    Raises:
        WorldError: The path is missing, unreadable, not a file, or larger than its bound, MB.
    """
    with readable(path):
        return read_file(path, megabytes, WorldError)


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Convert an OSError about a missing or unreadable file to a WorldError."""
    try:
        yield
    except FileNotFoundError:
        raise WorldError(f"{path}: there is no such file; {_others(path)}") from None
    except OSError as error:
        raise WorldError(f"{path}: cannot be read: {error.strerror or error}") from None


def _others(path: Path) -> str:
    if not path.parent.is_dir():
        return f"there is no folder {path.parent} either"
    others = [p.name for p in path.parent.iterdir() if p.suffix == path.suffix]
    return did_you_mean(path.name, others) if others else f"{path.parent} holds no {path.suffix or 'such'} file at all"
