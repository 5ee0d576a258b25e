"""Commands that act on a live robot: goal, cancel, swap, stop, resume, params."""

from __future__ import annotations

import math
import sys
from typing import Annotated, Any

import typer

from navloom.cli.live_options import AsJson, Connect, Insecure, Keys, RobotName

__all__ = ["cancel", "goal", "params", "resume", "stop", "swap"]

params = typer.Typer(help="Parameters of a live robot's plugins.", no_args_is_help=True)
NUMBERS = {"ignore_unknown_options": True}
"""Lets -1.5 be a coordinate instead of an option."""


def goal(
    x: Annotated[float, typer.Argument(metavar="X", help="m, map frame.")],
    y: Annotated[float, typer.Argument(metavar="Y", help="m, map frame.")],
    heading: Annotated[
        float | None, typer.Argument(metavar="[HEADING]", help="Degrees to end with; default: any.")
    ] = None,
    via: Annotated[list[str] | None, typer.Option(metavar="X,Y", help="Point to pass on the way; repeats.")] = None,
    timeout: Annotated[float | None, typer.Option(metavar="S", help="Give up waiting after s; it drives on.")] = None,
    no_wait: Annotated[bool, typer.Option("--no-wait", help="Return when it is accepted.")] = False,
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Send a live robot to a place and follow it there. Exit 0: the goal was reached."""
    from navloom.cli.output import print_json
    from navloom.runtime.client import Refused
    from navloom.runtime.navigator import Navigator, rejection

    points = [_point(text) for text in via or ()]
    with Navigator(robot, connect, keys, insecure) as navigator:
        try:
            handle = navigator.go(x, y, None if heading is None else math.radians(heading), points)
        except Refused as refusal:
            _end(rejection(refusal, x, y), as_json)
        if no_wait:
            print_json({"goal_id": handle.goal_id}) if as_json else typer.echo(f"goal {handle.goal_id} accepted")
            return
        try:
            for feedback in handle.updates(timeout):
                if not as_json:
                    _tell(feedback)
        except TimeoutError as error:
            typer.echo(f"navloom: {error}; it drives on, `navloom cancel` ends it", err=True)
            raise typer.Exit(1) from None
        assert handle.result is not None
        _end(handle.result, as_json)


def cancel(robot: RobotName = None, connect: Connect = None, keys: Keys = None, insecure: Insecure = False) -> None:
    """End the goal that a live robot is at."""
    from navloom.runtime.navigator import Navigator

    with Navigator(robot, connect, keys, insecure) as navigator:
        navigator.cancel()
    typer.echo("cancelled")


def stop(robot: RobotName = None, connect: Connect = None, keys: Keys = None, insecure: Insecure = False) -> None:
    """Stop a live robot until `navloom resume`; its goal waits."""
    from navloom.runtime.navigator import Navigator

    with Navigator(robot, connect, keys, insecure) as navigator:
        navigator.stop()
    typer.echo("stopped; `navloom resume` lets it drive again")


def resume(robot: RobotName = None, connect: Connect = None, keys: Keys = None, insecure: Insecure = False) -> None:
    """Let a live robot drive again after a stop, a contact or teleop."""
    from navloom.runtime.navigator import Navigator

    with Navigator(robot, connect, keys, insecure) as navigator:
        navigator.resume()
    typer.echo("resumed")


def swap(
    role: Annotated[str, typer.Argument(metavar="ROLE", help="As avoider.")],
    instance: Annotated[str, typer.Argument(metavar="NAME", help="Instance of the config to put in charge.")],
    timeout: Annotated[float, typer.Option(metavar="S", help="s it may take to warm up.")] = 10.0,
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Put another instance of a role in charge, in the middle of a drive, as soon as it has warmed up."""
    from navloom.cli.output import print_json
    from navloom.runtime.navigator import Navigator

    with Navigator(robot, connect, keys, insecure) as navigator:
        try:
            epoch = navigator.swap(role, instance, timeout)
        except TimeoutError as error:
            typer.echo(f"navloom: {error}", err=True)
            raise typer.Exit(1) from None
    if as_json:
        print_json({"role": role, "instance": instance, "epoch": epoch})
    else:
        typer.echo(f"{role}: {instance} is in charge (selection {epoch})")


@params.command("get")
def get_params(
    target: Annotated[str, typer.Argument(metavar="ROLE[.NAME]", help="As controller or avoider.forces.")],
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Print an instance's parameters as they are now."""
    from navloom.runtime.navigator import Navigator

    with Navigator(robot, connect, keys, insecure) as navigator:
        _print_params(navigator.get_parameters(*_target(navigator, target)), as_json)


@params.command("set")
def set_params(
    target: Annotated[str, typer.Argument(metavar="ROLE[.NAME]", help="As controller or avoider.forces.")],
    values: Annotated[list[str], typer.Argument(metavar="NAME=VALUE…", help="As k3=1.0; all or none are taken.")],
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Change an instance's parameters between two ticks: all of them, or none where one does not fit."""
    from navloom.config.loader import parse_override
    from navloom.dataflow.events import assignments
    from navloom.runtime.navigator import Navigator

    wanted = assignments(dict(parse_override(value) for value in values))
    with Navigator(robot, connect, keys, insecure) as navigator:
        _print_params(navigator.set_parameters(*_target(navigator, target), wanted), as_json)


def _target(navigator: Any, text: str) -> tuple[str, str]:
    """Role and instance; where none is named, the one in charge."""
    from navloom.runtime.client import ClientError

    role, _, name = text.partition(".")
    if name:
        return role, name
    found = [one for one in navigator.client.describe() if one["role"] == role]
    if not found:
        raise ClientError(f"no {role!r} answers; `navloom list` shows who is there")
    return role, next((one["instance"] for one in found if one["active"]), found[0]["instance"])


def _print_params(values: dict[str, Any], as_json: bool) -> None:
    from navloom.cli.output import print_json, print_table

    if as_json:
        print_json(values)
    else:
        print_table(("parameter", "value"), list(values.items()))


def _point(text: str) -> tuple[float, float]:
    x, comma, y = text.partition(",")
    try:
        if not comma:
            raise ValueError
        return float(x), float(y)
    except ValueError:
        raise typer.BadParameter(f"{text!r}, expected X,Y as in 1.0,2.5") from None


def _tell(feedback: Any) -> None:
    """One line a feedback; where somebody looks, over the one before."""
    text = f"{feedback.state}: {feedback.distance:.2f} m, {feedback.time_left:.0f} s left"
    if feedback.recoveries:
        text += f", recoveries {feedback.recoveries}"
    if sys.stdout.isatty():
        print(f"\r{text:<60}", end="", flush=True)
    else:
        print(text, flush=True)


def _end(result: Any, as_json: bool) -> None:
    from navloom.cli.output import print_json

    place = result.place
    if as_json:
        print_json(
            {"goal_id": result.goal_id, "outcome": result.outcome, "reason": result.reason, "place": [place.x, place.y]}
        )
    else:
        if sys.stdout.isatty():
            print()
        typer.echo(f"{result.outcome}: {result.reason}, at ({place.x:.2f}, {place.y:.2f})")
    raise typer.Exit(0 if result.outcome == "succeeded" else 1)
