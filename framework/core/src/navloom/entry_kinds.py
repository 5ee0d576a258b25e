"""Kinds of plugin entry points. Keep it light: every start of `navloom` imports it."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, NamedTuple

from navloom.parts import OF_FRAMEWORK

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.metadata import EntryPoints

__all__ = ["GROUP", "OTHERS", "TRACEBACK", "TRACE_HOOKS", "CommandPoint", "added_commands", "installed_points"]

GROUP = "navloom"
"""Group of the entry points; each is named KIND.NAME, and its kind is a role or one of OTHERS."""
OTHERS = ("world", "scheme", "metric", "panel", "node", "message", "command", "observer", "suite")
TRACE_HOOKS = "NAVLOOM_TRACE_HOOKS"
"""Environment variable: if not empty, every hook call is printed, in child processes too."""
TRACEBACK = "NAVLOOM_TRACEBACK"
"""Environment variable: if not empty, tracebacks of errors are kept and printed, in child processes too."""


def installed_points() -> EntryPoints:
    """Every entry point of the group, found without importing its module."""
    from importlib.metadata import entry_points

    return entry_points(group=GROUP)


class CommandPoint(NamedTuple):
    """A command that a distribution adds, as its metadata describes it.

    Attributes:
        name: Name of the command, typed after `navloom`.
        value: Module that registers it.
        distribution, version: Its distribution.
        summary: Its purpose in one line: from the README's line "- `navloom NAME`: purpose", else the distribution's.
    """

    name: str
    value: str
    distribution: str
    version: str
    summary: str


def added_commands() -> list[CommandPoint]:
    """Commands of the installed distributions, read from their metadata files: first navloom's, in the README's order.

    This takes 2 ms; importlib.metadata takes 30 ms, its own import included.
    """
    found: dict[str, list[CommandPoint]] = {}
    for folder in sys.path:
        try:
            # Sorted, because the order of a folder differs between file systems.
            names = sorted(os.listdir(folder or "."))
        except OSError:  # no folder, or a zip file, which holds no installed distributions
            continue
        for name in names:
            if name.endswith((".dist-info", ".egg-info")):
                of_one = list(_commands_of(os.path.join(folder, name)))
                if of_one:
                    found.setdefault(of_one[0].distribution, of_one)  # the first in `sys.path` wins
    ordered = sorted(found, key=lambda name: (name not in OF_FRAMEWORK, name))
    return [command for name in ordered for command in found[name]]


def _commands_of(info: str) -> Iterator[CommandPoint]:
    """The commands of one distribution, given the folder of its metadata; those that its README describes first."""
    text = _text_of(os.path.join(info, "entry_points.txt"))
    # Most distributions add no command, and their METADATA is long.
    if "command." not in text:
        return
    head, _, page = (_text_of(os.path.join(info, "METADATA")) or _text_of(os.path.join(info, "PKG-INFO"))).partition(
        "\n\n"
    )
    told = dict(line.split(": ", 1) for line in head.splitlines() if ": " in line)
    modules, section = {}, ""
    for line in text.splitlines():
        key, _, target = (part.strip() for part in line.partition("="))
        if line.startswith("["):
            section = line.strip("[] ")
        elif section == GROUP and key.startswith("command."):
            modules[key.removeprefix("command.")] = target
    # From the README in the metadata: `--help` imports no command, strangers' commands are described as navloom's own,
    # and the README keeps the list that its readers look for.
    described = {}
    for line in page.splitlines():
        if line.startswith("- `navloom "):
            name, _, summary = line.removeprefix("- `navloom ").partition("`: ")
            described[name] = summary
    for name in dict.fromkeys([*(name for name in described if name in modules), *modules]):
        owner = told.get("Name", modules[name])
        yield CommandPoint(
            name, modules[name], owner, told.get("Version", ""), described.get(name) or told.get("Summary", "")
        )


def _text_of(path: str) -> str:
    """Text of a file; empty if it is missing or unreadable."""
    try:
        with open(path, encoding="utf-8") as file:
            return file.read()
    except (OSError, UnicodeDecodeError):
        return ""
