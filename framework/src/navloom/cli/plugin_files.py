"""The option `--plugin FILE.py`: plugins in one file, without packaging."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["PluginFiles"]


def _use(files: list[Path] | None) -> list[Path] | None:
    if files:
        from navloom.plugins.one_file import use_files

        with redirect_stdout(sys.stderr):  # a file may print when it is imported
            use_files(files)
    return files


PluginFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin", metavar="FILE.py", help="Use the plugins in a Python file too, without packaging; repeats.",
        callback=_use,
    ),
]  # fmt: skip
