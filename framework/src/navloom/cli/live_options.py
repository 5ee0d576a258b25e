"""Options of every command that acts on, or looks into, a live robot."""

from __future__ import annotations

import math
from typing import Annotated

import typer

__all__ = ["VIEWER", "AsJson", "Connect", "Insecure", "Keys", "RobotName", "a_number", "seconds"]

VIEWER = "viewer"
"""Certificate that is enough to look."""


def a_number(value: float | None) -> float | None:
    """Check of an option or argument: any number, but no NaN and no infinity."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"got {value}, expected a finite number")
    return value


def seconds(value: float | None) -> float | None:
    """Check of an option: a time above 0 s."""
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"got {value:g}, expected a number of seconds above 0")
    return value


RobotName = Annotated[
    str | None,
    typer.Option("--robot", metavar="REALM/NAME", help="Which robot, as lab/r1 or r1; default: the only one up."),
]
Connect = Annotated[
    str | None, typer.Option("--connect", metavar="ENDPOINT", help="Router of a robot elsewhere, as tls/10.0.0.1:7447.")
]
Keys = Annotated[
    str | None,
    typer.Option(
        "--keys", metavar="DIR", help="Folder of certificates made by `navloom keys`, or one in it, as DIR/alice.pem."
    ),
]
Insecure = Annotated[bool, typer.Option("--insecure", help="Plain TCP to another host, in a closed test network only.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
