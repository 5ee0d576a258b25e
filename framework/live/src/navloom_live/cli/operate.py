"""Commands that act on a live robot: goal, cancel, place, relocalise, swap, stop, resume, params."""

from __future__ import annotations

import math
import sys
from typing import Annotated, Any, NoReturn

import typer
from navloom.cli.command import App, made_with
from navloom.cli.options import AsJson, RobotOptions, a_heading, a_number, seconds
from navloom.cli.output import LOG
from navloom.inputs import printable

__all__ = ["cancel", "goal", "params", "place", "relocalise", "resume", "stop", "swap"]


def a_spread(value: float | None) -> float | None:
    """Check of an option: a standard deviation."""
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"got {value:g}, expected a number above 0")
    return value


params = App(help="Parameters of a live robot's plugins.", no_args_is_help=True)
NUMBERS = made_with(context_settings={"ignore_unknown_options": True})
"""Lets -1.5 be a coordinate of a command instead of an option."""


@NUMBERS
def goal(
    x: Annotated[float, typer.Argument(metavar="X", help="m, map frame.", callback=a_number)],
    y: Annotated[float, typer.Argument(metavar="Y", help="m, map frame.", callback=a_number)],
    heading: Annotated[
        float | None,
        typer.Argument(metavar="[HEADING]", help="Heading at the goal, deg; default: any.", callback=a_heading),
    ] = None,
    via: Annotated[list[str] | None, typer.Option(metavar="X,Y", help="Point to pass on the way; repeats.")] = None,
    timeout: Annotated[
        float | None,
        typer.Option(metavar="S", help="End the command after this time, s; the robot continues.", callback=seconds),
    ] = None,
    no_wait: Annotated[bool, typer.Option("--no-wait", help="Return once the goal is accepted.")] = False,
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Send a live robot to a goal and show its progress.

    Exit 0: the goal was reached; 2: it was rejected before the robot moved.
    """
    from navloom.cli.output import print_json
    from navloom.inputs import warn_of_radians

    from navloom_live.cli.live_line import LiveLine, goal_line
    from navloom_live.operating.client import ClientError, Refused
    from navloom_live.operating.navigator import rejection

    points = [_point(text) for text in via or ()]
    warn_of_radians(heading or 0.0)
    with robot.navigator() as navigator:
        try:
            handle = navigator.go(x, y, None if heading is None else math.radians(heading), points)
        except Refused as refusal:
            _end(rejection(refusal, x, y), as_json)
        if no_wait:
            print_json({"goal_id": handle.goal_id}) if as_json else typer.echo(f"goal {handle.goal_id} accepted")
            return
        line = LiveLine(sys.stdout)
        try:
            for feedback in handle.updates(timeout):
                if not as_json:
                    line.show(*goal_line(feedback, handle.gate, handle.speed))
            result = handle.result
        except TimeoutError as error:
            _leave(line, f"{error}; it drives on, `navloom cancel` ends it", 1)
        except KeyboardInterrupt:
            _leave(line, f"goal {handle.goal_id} is still on its way; `navloom cancel` ends it", 130)
        except ClientError as error:
            line.end()
            _end_unknown(handle.goal_id, str(error), as_json)
        line.end()
        _end(result, as_json)


def cancel(robot: RobotOptions) -> None:
    """Cancel the goal of a live robot."""
    from navloom_live.operating import operator_actions

    with robot.operate() as client:
        there_was_one = operator_actions.cancel(client)
    typer.echo("cancelled" if there_was_one else "no goal to cancel")


@NUMBERS
def place(
    x: Annotated[float, typer.Argument(metavar="X", help="m, map frame.", callback=a_number)],
    y: Annotated[float, typer.Argument(metavar="Y", help="m, map frame.", callback=a_number)],
    heading: Annotated[float, typer.Argument(metavar="HEADING", help="deg, map frame.", callback=a_heading)],
    spread: Annotated[
        float | None,
        typer.Option(metavar="M", help="It is a guess: standard deviation of X and of Y, m.", callback=a_spread),
    ] = None,
    heading_spread: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="It is a guess: standard deviation of HEADING, deg.", callback=a_spread),
    ] = None,
    *,
    robot: RobotOptions,
) -> None:
    """Tell a live robot where it is, or about where. With a guess, it searches near there.

    Also while it drives to a goal, which is planned again from there, and while it does not know where it is.
    """
    from navloom.inputs import warn_of_radians
    from navloom.inputs.spreads import sigma_of

    from navloom_live.operating import operator_actions

    warn_of_radians(heading)
    with robot.operate() as client:
        sigma = sigma_of(spread, heading_spread)
        warning = operator_actions.place(client, x, y, math.radians(heading), sigma)
    if warning:
        LOG.warning(warning)
    does = "placed at" if sigma is None else "searches near"
    typer.echo(f"{does} ({x:g}, {y:g}), {heading:g}°; `navloom status` shows whether it tracks")


def relocalise(robot: RobotOptions) -> None:
    """Have a live robot search for itself on the whole map. It forgets where it is.

    A goal waits meanwhile; with the recovery look_around, the robot moves to see more. Without a goal it stays stopped.
    """
    from navloom_live.operating import operator_actions

    with robot.operate() as client:
        operator_actions.relocalise(client)
    typer.echo("searches on the whole map; `navloom status` shows whether it tracks")


def stop(
    every: Annotated[bool, typer.Option("--all", help="Every robot of this user on this host.")] = False,
    *,
    robot: RobotOptions,
) -> None:
    """Stop a live robot until `navloom resume`; its goal waits.

    Exit 0: every robot that it is for has stopped.
    """
    from navloom_live.operating.stop_command import stop_robots

    raise typer.Exit(stop_robots(**vars(robot), every=every))


def resume(robot: RobotOptions) -> None:
    """Let a robot drive again after a stop, a contact or teleop."""
    from navloom_live.operating import operator_actions

    with robot.operate() as client:
        operator_actions.resume(client)
    typer.echo("resumed")


def swap(
    role: Annotated[str, typer.Argument(metavar="ROLE", help="Role, as avoider.")],
    instance: Annotated[
        str, typer.Argument(metavar="NAME", help="Instance of the robot, or another plugin or plugin@preset.")
    ],
    timeout: Annotated[float, typer.Option(metavar="S", help="Longest time to warm up, s.", callback=seconds)] = 10.0,
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Make another instance of a role active, also during a drive.

    A method that the robot does not have is started in shadow first. The swap takes effect as soon as the instance has
    warmed up.
    """
    from navloom.cli.output import print_json

    from navloom_live.operating import operator_actions

    with robot.operate() as client:
        try:
            epoch = operator_actions.swap(client, role, instance, timeout, LOG.info)
        except TimeoutError as error:
            LOG.warning(str(error))
            raise typer.Exit(1) from None
    if as_json:
        print_json({"role": role, "instance": instance, "epoch": epoch})
    else:
        typer.echo(f"{role}: {instance} is active (selection {epoch})")


@params.command("get")
def get_params(
    target: Annotated[str, typer.Argument(metavar="ROLE[.NAME]", help="As controller or avoider.forces.")],
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Print the current parameters of an instance."""
    from navloom_live.operating import operator_actions

    with robot.operate() as client:
        _print_params(operator_actions.get_parameters(client, *_target(client, target)), as_json)


@params.command("set")
def set_params(
    target: Annotated[str, typer.Argument(metavar="ROLE[.NAME]", help="As controller or avoider.forces.")],
    values: Annotated[list[str], typer.Argument(metavar="NAME=VALUE…", help="As k3=1.0; all or none are taken.")],
    *,
    robot: RobotOptions,
    as_json: AsJson = False,
) -> None:
    """Change parameters of an instance between two ticks.

    Either all of them change, or none if one is invalid.
    """
    from navloom.inputs.assignments import assignments, read_assignment

    from navloom_live.operating import operator_actions

    given: dict[str, Any] = {}
    for text in values:
        name = text.partition("=")[0].strip()
        if "=" not in text or not name:
            raise typer.BadParameter(f"{text!r}: expected NAME=VALUE, as in k3=1.0")
        if name in given:
            raise typer.BadParameter(f"{text!r}: {name} is given twice")
        given |= [read_assignment(text, "parameter", typer.BadParameter)]
    wanted = assignments(given)
    with robot.operate() as client:
        _print_params(operator_actions.set_parameters(client, *_target(client, target), wanted), as_json)


def _target(client: Any, text: str) -> tuple[str, str]:
    """Role and instance of a plugin, by default the active one. Raises Refused if there is none."""
    from navloom.misspelt import nearest

    from navloom_live.operating.client import ClientError, Refused

    role, dot, name = text.partition(".")
    plugins = [node for node in client.describe() if node.plugin]
    if not plugins:
        raise ClientError("no plugin of the robot answers; `navloom doctor` says why")
    found = {plugin.instance: plugin.active for plugin in plugins if plugin.role == role}
    if not found:
        raise Refused(
            f"{text!r}: no plugin of role {role!r} answers{nearest(role, sorted({plugin.role for plugin in plugins}))}"
        )
    if dot and name not in found:
        raise Refused(f"{text!r}: no {role} {name!r} answers{nearest(name, list(found))}")
    return role, name if dot else next((one for one, active in found.items() if active), next(iter(found)))


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
        point = float(x), float(y)
        if not all(math.isfinite(value) for value in point):
            raise ValueError
        return point
    except ValueError:
        raise typer.BadParameter(f"--via {text}: expected two finite numbers X,Y as in 1.0,2.5") from None


def _leave(line: Any, text: str, code: int) -> NoReturn:
    line.end()
    LOG.info(text)
    raise typer.Exit(code)


def _end(result: Any, as_json: bool) -> NoReturn:
    from navloom.cli.output import print_json

    place = result.place
    if as_json:
        told = {"goal_id": result.goal_id, "outcome": result.outcome, "reason": result.reason, "code": result.code}
        print_json({**told, "place": [place.x, place.y]})
    else:
        typer.echo(printable(f"{result.outcome}: {result.reason}, at ({place.x:z.2f}, {place.y:z.2f})"))
    raise typer.Exit({"succeeded": 0, "rejected": 2}.get(result.outcome, 1))


def _end_unknown(goal_id: int, reason: str, as_json: bool) -> NoReturn:
    """Report an error for a goal whose robot is gone: no node is left to say where the robot is."""
    from navloom.cli.output import print_json

    if as_json:
        print_json({"goal_id": goal_id, "outcome": "error", "reason": reason, "place": None})
    else:
        typer.echo(printable(f"error: {reason}"))
    raise typer.Exit(1)
