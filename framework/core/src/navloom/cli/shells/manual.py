"""`navloom man`: the manual page, generated from the help of every command."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from navloom.cli.shells.tree import CommandEntry, Word

__all__ = ["man", "page"]

ENDS = (
    ("0", "Done; of a command that drives: the goal was reached."),
    ("1", "The run ended otherwise, or something failed on the way."),
    ("2", "The request was wrong; nothing ran and nothing was written."),
)
ENVIRONMENT = (
    ("NAVLOOM_RUNTIME_DIR", "Folder where robots that are up are found; default: navloom in XDG_RUNTIME_DIR."),
    ("NAVLOOM_MAX_INPUT_MB", "Bound of every file that is read, MB; default: one for each kind, 0.25 to 1024."),
    ("NAVLOOM_TRACE_HOOKS", "Not empty: as the option --trace-hooks."),
    ("NAVLOOM_TRACEBACK", "Not empty: as the option --traceback."),
    ("NUMBA_CACHE_DIR", "Folder of compiled kernels; default: beside the modules."),
)


def man(context: typer.Context) -> None:
    """Print the manual page.

    For `man navloom`, save it as navloom.1 in a man1 folder, such as ~/.local/share/man/man1.
    """
    from navloom.cli.shells.tree import commands
    from navloom.installed import framework_version

    typer.echo(page(commands(context.find_root().command), framework_version()), nl=False)


def page(tree: Sequence[CommandEntry], version: str) -> str:
    """The manual page in roff."""
    root, *others = tree
    lines = [
        f'.TH NAVLOOM 1 "" "navloom {version}" "User Commands"',
        ".SH NAME",
        rf"navloom \- {_text(root.summary[0].lower() + root.summary[1:]).rstrip('.')}",
        ".SH SYNOPSIS",
        r".B navloom",
        _text(root.usage),
        ".SH DESCRIPTION",
        _text(root.help),
        "A command runs one robot, simulated or live, looks into it, or compares methods.",
        ".SH OPTIONS",
        *_words(root.options),
        ".SH COMMANDS",
    ]
    for command in others:
        lines += _command(command)
    lines += [".SH EXIT STATUS", *_terms(ENDS), ".SH ENVIRONMENT", *_terms(ENVIRONMENT)]
    return "\n".join(lines) + "\n"


def _command(command: CommandEntry) -> Iterator[str]:
    yield f".SS {_text(f'{command.name} {command.usage}')}"
    for paragraph in re.split(r"\n\s*\n", command.help.strip()):
        yield _text(paragraph)
        yield ".PP"
    if not command.inner:
        yield from _words((*command.arguments, *(word for word in command.options if word.names != ("--help",))))


def _words(words: Sequence[Word]) -> Iterator[str]:
    for word in words:
        names = ", ".join(rf"\fB{_text(name)}\fR" for name in word.names)
        value = rf"\fI{_text(word.metavar)}\fR" if word.metavar else ""
        yield ".TP"
        yield f"{names} {value}".strip()
        yield _text(word.help) or r"\&"


def _terms(terms: Sequence[tuple[str, str]]) -> Iterator[str]:
    for name, meaning in terms:
        yield ".TP"
        yield rf"\fB{name}\fR"
        yield _text(meaning)


def _text(text: str) -> str:
    """One line of roff in ASCII that does not begin with a roff command."""
    line = " ".join(text.split()).replace("\\", r"\e").replace("-", r"\-")
    line = "".join(one if one.isascii() else rf"\[u{ord(one):04X}]" for one in line)
    return rf"\&{line}" if line[:1] in (".", "'") else line
