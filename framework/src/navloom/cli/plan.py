"""`navloom plan`: one path on one map."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any

import typer

__all__ = ["plan"]


def plan(
    map_: Annotated[str, typer.Argument(metavar="MAP", help="A world reference, or a map_server .yaml file.")],
    start: Annotated[str, typer.Option("--from", metavar="X,Y", help="m, map frame.")],
    goal: Annotated[str, typer.Option("--to", metavar="X,Y", help="m, map frame.")],
    planner: Annotated[str, typer.Option(metavar="NAME", help="Planner plugin.")] = "astar",
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=V", help="A parameter of the planner; repeats.")
    ] = None,
    size: Annotated[str, typer.Option(metavar="L,W", help="Length and width of the robot, m; 0,0 is a point.")] = "0,0",
    resolution: Annotated[float, typer.Option(metavar="M", help="Cell of maps without a raster, m.")] = 0.05,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Plan one path on one map. Exit 0: there is one; 1: there is none, and the message says where it ends."""
    from navloom.cli.output import print_json
    from navloom.study.planning import plan_once

    reference = f"rosmap:{map_}" if map_.endswith((".yaml", ".yml")) else map_
    answer: dict[str, Any] = plan_once(
        reference,
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
        typer.echo(f"{answer['length_m']:.3f} m in {answer['planner_ms']:.2f} ms, {len(answer['points'])} points")
        typer.echo(" ".join(f"({x:.2f}, {y:.2f})" for x, y in answer["points"]))
    else:
        typer.echo(f"{answer['outcome']}: {answer['reason']}")
    raise typer.Exit(0 if answer["outcome"] == "found" else 1)


def _pair(text: str, option: str, form: str) -> tuple[float, float]:
    from navloom.config import ConfigError

    try:
        x, y = map(float, text.split(","))
    except ValueError:
        raise ConfigError(f"{option} {text}: expected {form} in metres, as in {option} 1.5,-2") from None
    return x, y
