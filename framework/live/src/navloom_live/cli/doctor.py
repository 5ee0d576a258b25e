"""`navloom doctor`: what is wrong, and what to do about it."""

from __future__ import annotations

import shutil
import sys
import textwrap

import typer
from navloom.cli.options import AsJson, RobotOptions
from navloom.inputs import printable

__all__ = ["doctor"]


def doctor(
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Find problems of a live robot or its network, with remedies.

    Exit 0: no problem.
    """
    from dataclasses import asdict

    from navloom.cli.output import print_json

    from navloom_live.operating.diagnosis import diagnose

    found = diagnose(robot.robot, robot.connect, robot.keys, "viewer", robot.insecure)
    if as_json:
        print_json(
            {
                "robot": found.robot or None,
                "healthy": found.is_healthy,
                "nodes": found.nodes,
                "findings": [asdict(finding) for finding in found.findings],
                "rate": asdict(found.rate) if found.rate is not None else None,
            }
        )
    else:
        if found.is_healthy:
            typer.echo(f"{found.robot}: {found.nodes} nodes, nothing is wrong")
        for finding in found.findings:
            typer.echo(_lines(f"{finding.severity}: {finding.what}"))
            typer.echo(_lines(f"    {finding.remedy}"))
        if found.rate is not None:
            typer.echo(_lines(str(found.rate)))
    raise typer.Exit(0 if found.is_healthy else 1)


def _lines(text: str) -> str:
    """A finding wrapped between words for a terminal; continuation lines are indented."""
    text = printable(text)
    if not sys.stdout.isatty():
        return text
    width = shutil.get_terminal_size().columns
    return textwrap.fill(text, width, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
