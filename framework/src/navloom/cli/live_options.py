"""Options of every command that acts on, or looks into, a live robot."""

from __future__ import annotations

from typing import Annotated

import typer

__all__ = ["VIEWER", "AsJson", "Connect", "Insecure", "Keys", "RobotName"]

VIEWER = "viewer"
"""Certificate that is enough to look."""

RobotName = Annotated[
    str | None, typer.Option("--robot", metavar="REALM/NAME", help="Which robot; default: the only one that is up.")
]
Connect = Annotated[
    str | None, typer.Option("--connect", metavar="ENDPOINT", help="Router of a robot elsewhere, as tls/10.0.0.1:7447.")
]
Keys = Annotated[
    str | None, typer.Option("--keys", metavar="DIR", help="Folder of certificates made by `navloom keys`.")
]
Insecure = Annotated[bool, typer.Option("--insecure", help="Plain TCP to another host, in a closed test network only.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
