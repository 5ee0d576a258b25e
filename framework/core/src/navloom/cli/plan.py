"""`navloom plan`: plans one path on one map."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import Annotated, Any

import typer

from navloom.cli.options import PluginFiles

__all__ = ["plan"]

STRAIGHT = 0.1
"""Largest distance of a path from the straight lines that are printed for it, m."""
FEW = 4
"""Number of corners at either end that are printed for a long path."""


def plan(
    map_: Annotated[str, typer.Argument(metavar="MAP", help="A world reference, or a map_server .yaml file.")],
    start: Annotated[str, typer.Option("--from", metavar="X,Y", help="m, map frame.")],
    goal: Annotated[str, typer.Option("--to", metavar="X,Y", help="m, map frame.")],
    planner: Annotated[str, typer.Option(metavar="NAME", help="Planner plugin.")] = "astar",
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=V", help="A parameter of the planner; repeats.")
    ] = None,
    plugin: PluginFiles = None,
    size: Annotated[str, typer.Option(metavar="L,W", help="Length and width of the robot, m; 0,0 is a point.")] = "0,0",
    resolution: Annotated[
        float, typer.Option(metavar="M", help="Cell of maps without a raster, m, 0.005 to 1.")
    ] = 0.05,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Plan one path on one map.

    Exit 0: a path was found; 1: there is none, and the message says how far the search got.
    """
    from navloom.cli.output import print_json
    from navloom.runs.single_plan import plan_once

    answer: dict[str, Any] = plan_once(
        map_,
        FilePath.cwd(),
        _pair(start, "--from", "X,Y"),
        _pair(goal, "--to", "X,Y"),
        planner=planner,
        changes=set_ or (),
        size=_pair(size, "--size", "L,W"),
        resolution=resolution,
    )
    if as_json:
        print_json(answer)
    elif answer["outcome"] == "found":
        _print_path(answer)
    else:
        typer.echo(f"{answer['outcome']}: {answer['reason']}")
    raise typer.Exit(0 if answer["outcome"] == "found" else 1)


def _print_path(answer: dict[str, Any]) -> None:
    """Print the length, the time, and the corners of the path."""
    import numpy as np

    from navloom.geometry.polylines import corners

    points = answer["points"]
    typer.echo(f"{answer['length_m']:.3f} m in {answer['planner_ms']:.2f} ms, {len(points)} points")
    turns = [f"({x:z.2f}, {y:z.2f})" for x, y in corners(np.array(points), STRAIGHT)]
    if len(turns) > 2 * FEW:
        turns = [*turns[:FEW], f"… {len(turns) - 2 * FEW} corners …", *turns[-FEW:]]
    hint = "" if len(turns) == len(points) else "; --json has every point"
    typer.echo(f"{' '.join(turns)}{hint}")


def _pair(text: str, option: str, form: str) -> tuple[float, float]:
    from navloom.config import ConfigError

    try:
        x, y = map(float, text.split(","))
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        example = "0.8,0.6" if option == "--size" else "1.5,-2"
        raise ConfigError(f"{option} {text}: expected {form}, two numbers in metres, as in {option} {example}")
    return x, y
