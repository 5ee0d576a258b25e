"""Finds the plugin of a run that a line of code belongs to, where there is no exception: for prints and threads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from types import FrameType
from typing import NamedTuple

__all__ = ["Owned", "Owners", "home_of", "place_in"]

Source = tuple[str, str]


class Owned(NamedTuple):
    """A line of a plugin: its role and instance, and the file and line, as `mine.py:31`."""

    source: Source
    place: str


def home_of(cls: type) -> str:
    """Name of the top-level package of a class."""
    return cls.__module__.partition(".")[0]


def place_in(frame: FrameType | None, home: str) -> str:
    """Innermost line of a package in a stack, as `mine.py:31, in avoid`; empty if there is none."""
    for frame_type in _outwards(frame):
        if _package(frame_type) == home:
            return f"{_line(frame_type)}, in {frame_type.f_code.co_name}"
    return ""


class Owners:
    """The plugins of a run, by their packages.

    Args:
        classes: Class of each plugin, by role and instance.
    """

    def __init__(self, classes: Mapping[Source, type]) -> None:
        self._classes = dict(classes)
        self._homes: dict[str, Source] = {}
        for source, cls in self._classes.items():
            self._homes.setdefault(home_of(cls), source)

    def of(self, frame: FrameType | None) -> Owned | None:
        """The plugin whose code is innermost in a stack; None if the stack contains no plugin code.

        Of several plugins in one package, it is the one whose method runs.
        """
        place, home = "", ""
        for frame_type in _outwards(frame):
            package = _package(frame_type)
            if package not in self._homes:
                continue
            if not place:
                place, home = _line(frame_type), package
            source = self._source_of(frame_type.f_locals.get("self"), frame_type.f_locals.get("cls"))
            if source is not None:
                return Owned(source, place)
        return Owned(self._homes[home], place) if place else None

    def _source_of(self, plugin: object, cls: object) -> Source | None:
        kind = cls if isinstance(cls, type) else type(plugin)
        instance = getattr(getattr(plugin, "context", None), "instance", None)
        found = [source for source, known in self._classes.items() if known is kind]
        return next((source for source in found if source[1] == instance), found[0] if found else None)


def _outwards(frame: FrameType | None) -> Iterator[FrameType]:
    while frame is not None:
        yield frame
        frame = frame.f_back


def _package(frame: FrameType) -> str:
    name: str = frame.f_globals.get("__name__", "")
    return name.partition(".")[0]


def _line(frame: FrameType) -> str:
    return f"{PurePath(frame.f_code.co_filename).name}:{frame.f_lineno}"
