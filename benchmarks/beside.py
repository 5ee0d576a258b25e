"""Shared by `engine_share` and `robot_cpu`: measures the navloom of this interpreter and of another one in turn.

This file imports only the standard library.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

__all__ = ["arguments", "clean_environment", "in_turns", "set_options"]

T = TypeVar("T")


def arguments(description: str | None) -> argparse.ArgumentParser:
    """Parser with CONFIG, --set, --beside and --json."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("config", nargs="?", default="paper", help="path or shipped name (default paper)")
    parser.add_argument("--set", action="append", default=[], metavar="A.B=V", help="change the config; repeats")
    parser.add_argument(
        "--beside", metavar="PYTHON", type=_interpreter, help="another interpreter, with a navloom of its own"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def _interpreter(text: str) -> str:
    if shutil.which(text) is None:
        raise argparse.ArgumentTypeError(f"{text}: not a program; expected an interpreter, such as .venv/bin/python")
    return text


def in_turns(
    beside: str | None,
    rounds: Iterable[int],
    measure: Callable[[str, int], T],
    told: Callable[[T], str],
) -> dict[str, list[T]]:
    """Measure each interpreter once per round; the order alternates from round to round.

    Args:
        beside: The other interpreter; None for this one alone.
        rounds: Numbers of the rounds.
        measure: Takes an interpreter and the number of the round.
        told: Makes a line about one measurement, for standard error.

    Returns:
        The measurement of each round, by "here" and "beside".
    """
    sides = {"here": sys.executable} | ({"beside": beside} if beside else {})
    found: dict[str, list[T]] = {side: [] for side in sides}
    for number in rounds:
        for side in sorted(sides, reverse=number % 2 == 0):
            one = measure(sides[side], number)
            found[side].append(one)
            print(f"{side}: {told(one)}", file=sys.stderr)
    return found


def clean_environment(**more: str) -> dict[str, str]:
    """This process's environment without PYTHONPATH: another interpreter must not find the navloom of this one."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | more


def set_options(changes: Sequence[str]) -> list[str]:
    """Command-line arguments that change a config: --set before each change."""
    return [word for change in changes for word in ("--set", change)]
