"""The command line as data: every command with its options and arguments, for shells and the man page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

__all__ = ["CommandEntry", "Word", "commands"]

KINDS = {
    "CONFIG": "configs",
    "REALM/NAME": "robots",
    "ROLE.NAME": "plugins",
    "ROLE|ROLE.NAME": "plugins",
    "ROLE": "roles",
    "ROLE[.NAME]": "roles",
    "MAP": "worlds",
    "REF": "worlds",
    "DIR": "folders",
    "FILE.py": "files",
    "FILE": "files",
    "BAG": "files",
    "SWEEP": "files",
    "SHELL": "shells",
}
"""Kind of candidates by metavar: a kind of `navloom.installed.candidates`, shells, folders or files."""


@dataclass(frozen=True)
class Word:
    """An option or an argument.

    Attributes:
        names: Names of an option, as --robot; empty for an argument.
        metavar: Placeholder of its value; empty for an option without a value.
        kind: Kind of its candidates; empty if there are none.
        repeats: Whether it may be given several times.
        needed: Whether it must be given.
        help: Help text, one sentence or more.
    """

    names: tuple[str, ...]
    metavar: str
    kind: str
    repeats: bool
    needed: bool
    help: str


@dataclass(frozen=True)
class CommandEntry:
    """A command, or a group of commands.

    Attributes:
        path: Its words, `navloom` first.
        help: Help text in paragraphs.
        options, arguments: Its words, in the order of the help.
        inner: Names of the commands in a group; empty for a command.
    """

    path: tuple[str, ...]
    help: str
    options: tuple[Word, ...]
    arguments: tuple[Word, ...]
    inner: tuple[str, ...]

    @property
    def name(self) -> str:
        """Full name, as it is typed."""
        return " ".join(self.path)

    @property
    def summary(self) -> str:
        """Its first sentence."""
        return re.split(r"(?<=[.!?])\s(?=[A-Z])", " ".join(self.help.split()), maxsplit=1)[0]

    @property
    def usage(self) -> str:
        """The synopsis after the name."""
        parts = ["[OPTIONS]"] + (["COMMAND …"] if self.inner else [])
        for word in self.arguments:
            name = word.metavar + "…" * word.repeats
            parts.append(name if word.needed else f"[{name}]")
        return " ".join(parts)


def commands(root: Any) -> list[CommandEntry]:
    """Every command below `navloom`, each group before its commands.

    Args:
        root: The root command of `navloom`, made by typer.
    """
    return list(_walk(root, ("navloom",)))


def _walk(command: Any, path: tuple[str, ...]) -> Iterator[CommandEntry]:
    inner = command.whole() if hasattr(command, "whole") else getattr(command, "commands", {})
    words = [_word(param) for param in command.params if not param.hidden]
    options = [word for word in words if word.names]
    options.append(Word(("--help",), "", "", False, False, "Print the help of the command."))
    arguments = [word for word in words if not word.names]
    yield CommandEntry(path, command.help or "", tuple(options), tuple(arguments), tuple(inner))
    for name, child in inner.items():
        yield from _walk(child, (*path, name))


def _word(param: Any) -> Word:
    is_option = param.param_type_name == "option"
    metavar = "" if is_option and param.is_flag else str(param.metavar or param.name).rstrip("…")
    if metavar.startswith("["):
        metavar = metavar.strip("[]")
    names = tuple(param.opts) if is_option else ()
    repeats = param.nargs == -1 or bool(param.multiple) if is_option else param.nargs == -1
    return Word(names, metavar, _kind(names, metavar), repeats, bool(param.required), param.help or "")


def _kind(names: tuple[str, ...], metavar: str) -> str:
    from navloom.roles import ROLES

    role = names[0].removeprefix("--") if names else ""
    if role in ROLES:  # such an option takes a plugin of the role
        return role
    return "files" if metavar.startswith("F.") else KINDS.get(metavar, "")
