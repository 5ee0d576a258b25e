"""Output of commands: tables and progress for people, one JSON object for scripts."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from navloom.escapes import printable

__all__ = [
    "LOG",
    "json_bytes",
    "json_line",
    "log_of",
    "paced",
    "print_json",
    "print_table",
    "progress_line",
    "say_so",
    "shown",
    "stage",
]

LOG = logging.getLogger("navloom.cli")
"""Logger of what is not the answer of a command."""
INTERVAL = 10.0
"""Shortest interval between lines of progress without a terminal, s."""
WIDE = 1000
"""Width of a table that goes to a file or another program, columns; wide enough that nothing is cut."""


def print_json(value: Any) -> None:
    """Print one JSON value to standard output; numbers that JSON lacks become null."""
    import json

    print(json.dumps(_plain(value), indent=2, ensure_ascii=False))


def json_line(value: Any) -> str:
    """One JSON value on one line; numbers that JSON lacks become null."""
    import json

    return json.dumps(_plain(value), ensure_ascii=False)


def json_bytes(value: Any) -> bytes:
    """One JSON value as a line of a file; numbers that JSON lacks become null."""
    return json_line(value).encode() + b"\n"


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return value


def print_table(columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print a table for people, as wide as its contents. On a narrower terminal, entries continue on the next line.

    Args:
        columns: Names of the columns; all empty for a table without a head.
        rows: Rows with one entry for each column.
    """
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    heads = [Column(name, overflow="fold") for name in columns]
    table = Table(*heads, box=None, pad_edge=False, show_header=any(columns))
    for row in rows:
        table.add_row(*(Text(shown(value)) for value in row))
    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDE)
    with console.capture() as captured:
        console.print(table)
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def shown(value: Any) -> str:
    """A value for people, on one line."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    return printable(str(value))


def paced(tell: Callable[[str], None] | None = None) -> Callable[[str], None]:
    """Log of progress where there is no terminal: a text that comes within 10 s of the previous one is dropped.

    Args:
        tell: Receives the others; None logs them.
    """
    from time import monotonic

    said = monotonic()

    def say(text: str) -> None:
        nonlocal said
        if monotonic() - said >= INTERVAL:
            said = monotonic()
            (tell or LOG.info)(text)

    return say


def say_so(text: str) -> None:
    """Log a note of the command line. It appears above a progress line."""
    LOG.info(text)


def log_of(house: str) -> logging.Logger:
    """The logger of a house, whose methods can be passed as `say`."""
    return logging.getLogger(f"navloom.{house}")


@contextmanager
def stage(quiet: bool) -> Iterator[tuple[Callable[[str], None], Callable[[float, float], None]]]:
    """Progress on standard error: preparation with the kernels that compile, then the state of the run.

    Without a terminal it prints only the kernels, at most one line in `INTERVAL`.
    """
    from navloom.kernel_cache import tell_compiled

    if quiet or not sys.stderr.isatty():
        tell_compiled(_log_of_kernels())
        try:
            yield (lambda text: None), (lambda done, total: None)
        finally:
            tell_compiled(None)
        return
    with progress_line("preparing") as update:
        step = "preparing"

        def say(text: str) -> None:
            nonlocal step
            step = text
            update(description=text)

        def compiled(kernels: Any) -> None:
            update(description=f"{step}: {kernels}", completed=kernels.ready, total=kernels.total)

        def progress(done: float, total: float) -> None:
            update(description=f"driving, {done:.0f} s of at most {total:.0f} s", completed=done, total=total)

        tell_compiled(compiled)
        try:
            yield say, progress
        finally:
            tell_compiled(None)


def _log_of_kernels() -> Callable[[Any], None]:
    says: list[Callable[[str], None]] = []

    def compiled(kernels: Any) -> None:
        if says:
            says[0](f"compiling {kernels}")
        else:
            LOG.info(f"compiling kernels, which later runs load: {kernels}")
            says.append(paced())

    return compiled


@contextmanager
def progress_line(text: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """A progress line on the standard error of a terminal, cut to one line. It is removed at the end.

    Yields a function that takes `description`, `completed`, `advance` and `total`, each by name. Text printed to
    `sys.stderr` in the meantime appears above the line.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.table import Column

    columns = (
        TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis")),
        BarColumn(20),
        TimeRemainingColumn(table_column=Column(no_wrap=True)),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=total)
        yield lambda **given: bar.update(task, **given)
