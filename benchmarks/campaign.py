"""Runs the drives of a campaign over several processes, and keeps each as it ends: a campaign can be continued."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from navloom_study.binomial import exact_interval

__all__ = ["kept", "rows_of", "share"]

T = TypeVar("T")
Row = dict[str, Any]


def kept(out: Path | None) -> list[Row]:
    """The rows that earlier runs have kept in a file; none without the file."""
    return [json.loads(line) for line in out.read_text("utf-8").splitlines()] if out and out.exists() else []


def rows_of(drive: Callable[[T], Row], work: Iterable[T], jobs: int, out: Path | None) -> Iterator[Row]:
    """The row of each piece of work, in the order in which they end; each is first added to the file, a JSON line.

    Args:
        drive: Function of a module, which other processes can find.
        work: What it is called with.
        jobs: Number of processes.
        out: The file.
    """
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for row in pool.imap_unordered(drive, work):
            if out:
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
            yield row


def share(which: Sequence[bool]) -> str:
    """The share of drives of which something is true, with its exact 95 % interval (Clopper and Pearson 1934)."""
    low, high = exact_interval(float(np.mean(which)), len(which))
    return f"{np.mean(which):.2f} ({low:.2f} to {high:.2f})"
