"""Errors of worlds and their files, and file access that raises only these."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import parse_qsl

from navloom.errors import NavloomError
from navloom.inputs.bounds import read_file
from navloom.misspelt import did_you_mean

__all__ = ["WorldError", "file_of", "options_of", "read_bytes", "readable", "seed_of"]


class WorldError(NavloomError, ValueError):
    """A world cannot be made; the text names the file and place, the given value and the expectation."""


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
            if any(f",{other}=" in value for other in defaults):
                raise WorldError(f"{argument!r}: separate options by &, not by a comma, as in ?key=value&key=value")
            options[key] = value
    return name, options


def seed_of(scheme: str, text: str) -> int:
    """The seed of a random world.

    Raises:
        WorldError: The text is not a whole number from 0.
    """
    # isdigit() also accepts superscripts, which int() refuses; 18 digits fit into 63 bits.
    if not (text.isascii() and text.isdigit() and len(text) <= 18):
        raise WorldError(f"{scheme}:{text}: expected a seed, a whole number from 0, as in {scheme}:3")
    return int(text)


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
