"""`navloom completion`: what makes a shell complete commands, options and values."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

__all__ = ["completion"]


class Shell(StrEnum):
    """Shells that can complete."""

    bash = "bash"
    zsh = "zsh"
    fish = "fish"


def completion(
    shell: Annotated[Shell, typer.Argument(metavar="SHELL", help="bash, zsh or fish.")],
) -> None:
    """Print a script that lets a shell complete commands, options, configs, plugins, worlds and robots.

    Save it where the shell looks for it: bash, ~/.local/share/bash-completion/completions/navloom; zsh, a file _navloom
    in a folder of $fpath; fish, ~/.config/fish/completions/navloom.fish. Save it again after an upgrade.
    """
    from navloom.cli.shells import SCRIPTS
    from navloom.cli.tree import commands

    typer.echo(SCRIPTS[shell.value](commands()), nl=False)
