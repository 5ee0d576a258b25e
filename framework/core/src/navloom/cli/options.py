"""Options that several commands share: each is declared once, and those that belong together are one dataclass.

A command takes such a dataclass as one parameter; `navloom.cli.command.App` turns it into its options. Commands of
other distributions may take them too.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navloom.escapes import printable
from navloom.installed import config_help
from navloom.parts import part

if TYPE_CHECKING:
    from navloom.config import Loaded

__all__ = [
    "AsJson",
    "Changes",
    "ConfigName",
    "ConfigOptions",
    "Insecure",
    "Keys",
    "MapOptions",
    "PluginFiles",
    "Record",
    "RobotName",
    "RobotOptions",
    "RunOptions",
    "Shadows",
    "ViewOptions",
    "ViewerOptions",
    "a_heading",
    "a_number",
    "seconds",
]

ROBOT, VIEWING, IMPORTED = "Which robot", "Viewer", "Imported log"
"""Sections of the help."""


def a_number(value: float | None) -> float | None:
    """Check of an option or argument: any finite number."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"got {value}, expected a finite number")
    return value


def a_heading(value: float | None) -> float | None:
    """Check of an argument: degrees within a turn to either side."""
    from navloom.inputs import heading_problem

    if value is not None and (problem := heading_problem(value)):
        raise typer.BadParameter(problem)
    return value


def seconds(value: float | None) -> float | None:
    """Check of an option: a time above 0 s."""
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"got {value:g}, expected a number of seconds above 0")
    return value


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ConfigName = Annotated[str, typer.Argument(metavar="CONFIG", help=config_help())]
Changes = Annotated[
    list[str] | None, typer.Option("--set", metavar="A.B=V", help="Change one value of the config; repeats.")
]

MethodName = Annotated[
    str, typer.Option("--method", metavar="NAME", help="Apply this [[method]] of the config, before --set.")
]


def _use_files(files: list[Path] | None) -> list[Path] | None:
    if files:
        from navloom.plugins.one_file import replaced_by, use_files

        with redirect_stdout(sys.stderr):  # a file may print when it is imported
            use_files(files)
        for line in replaced_by(files):
            typer.echo(printable(line), err=True)
    return files


PluginFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE.py",
        help="Also use the plugins in this Python file; repeats.",
        callback=_use_files,
    ),
]
Shadows = Annotated[
    list[str] | None,
    typer.Option(
        "--shadow",
        metavar="ROLE=A,B",
        help="Run these plugins beside the active one, as avoider=vff,vfh@printed; repeats.",
    ),
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="Seed of every random stream.")]
Record = Annotated[Path | None, typer.Option(metavar="F.mcap", help="Record every message and step, also of shadows.")]
RobotName = Annotated[
    str | None,
    typer.Option(
        "--robot",
        metavar="REALM/NAME",
        help="Which robot, as lab/r1 or r1; default: the only one up.",
        rich_help_panel=ROBOT,
    ),
]
Connect = Annotated[
    str | None,
    typer.Option(
        "--connect",
        metavar="ENDPOINT",
        help="Router of a robot elsewhere, as tls/10.0.0.1:7447.",
        rich_help_panel=ROBOT,
    ),
]
Keys = Annotated[
    str | None,
    typer.Option(
        "--keys",
        metavar="DIR",
        help="Folder of certificates made by `navloom keys`, or one in it, as DIR/alice.pem.",
        rich_help_panel=ROBOT,
    ),
]
Insecure = Annotated[
    bool,
    typer.Option("--insecure", help="Plain TCP to another host, in a closed test network only.", rich_help_panel=ROBOT),
]


def _join(*given: Any, **further: Any) -> AbstractContextManager[Any]:
    joined: AbstractContextManager[Any] = part("navloom_live.operating.robot_lookup", "a live robot").join(
        *given, **further
    )
    return joined


@dataclass(frozen=True)
class RobotOptions:
    """Which live robot a command is about, and how to reach it."""

    robot: RobotName = None
    connect: Connect = None
    keys: Keys = None
    insecure: Insecure = False

    def look(self) -> AbstractContextManager[Any]:
        """Join the robot's network; the certificate of a viewer is enough. Gives a `Client`."""
        return _join(self.robot, self.connect, self.keys, "viewer", self.insecure)

    def operate(self) -> AbstractContextManager[Any]:
        """Join the robot's network as an operator. Gives a `Client`."""
        return _join(self.robot, self.connect, self.keys, insecure=self.insecure)

    def navigator(self) -> Any:
        """A `Navigator` for the robot, with an operator's certificate."""
        navigator: Any = part("navloom_live.operating.navigator", "a live robot")
        return navigator.Navigator(self.robot, self.connect, self.keys, self.insecure)

    def first_given(self) -> str:
        """The first of these options that was given; empty if none was."""
        return next((f"--{name}" for name, value in vars(self).items() if value), "")


@dataclass(frozen=True)
class ConfigOptions:
    """A config with changes, and the plugins of files."""

    config: ConfigName
    method: MethodName = ""
    set_: Changes = None
    plugin: PluginFiles = None

    def load(self) -> Loaded:
        """Read it. Raises ConfigError."""
        from navloom.config import load_config

        return load_config(self.config, self.set_ or (), method=self.method)


@dataclass(frozen=True)
class RunOptions(ConfigOptions):
    """A config with changes, the seed of its random streams, and plugins in shadow."""

    seed: Seed = None
    shadow: Shadows = None

    def load(self, say: Callable[[str], None] | None = None) -> Loaded:
        """Read it, and say which parameters were dropped with a replaced plugin. Raises ConfigError."""
        from navloom.config import load_config

        loaded = load_config(self.config, self.set_ or (), self.seed, self.shadow or (), self.method)
        for notice in loaded.notices() if say is not None else ():
            say(notice)  # type: ignore[misc]
        return loaded


@dataclass(frozen=True)
class MapOptions:
    """The map of an imported log, and where in it the robot is when the log begins."""

    map_: Annotated[
        str | None,
        typer.Option(
            "--map", metavar="WORLD", help="Map for replays, a world or a map's .yaml.", rich_help_panel=IMPORTED
        ),
    ] = None
    start: Annotated[
        str | None,
        typer.Option(
            "--start",
            metavar="X,Y,HEADING_DEG",
            help="Where the robot is at first, in the map.",
            rich_help_panel=IMPORTED,
        ),
    ] = None

    def pose(self) -> tuple[float, float, float] | None:
        """The start, x, y, m, heading, rad; None if it was not given. Raises ConfigError."""
        return (
            None if self.start is None else part("navloom_recording.imported_log", "--start").start_option(self.start)
        )


@dataclass(frozen=True)
class ViewerOptions:
    """Where something is shown."""

    web: Annotated[
        bool,
        typer.Option(
            "--web",
            help="Serve the viewer to a browser instead of opening a window; Ctrl-C ends it.",
            rich_help_panel=VIEWING,
        ),
    ] = False
    viewer: Annotated[
        str | None,
        typer.Option(
            "--viewer",
            metavar="URL",
            help="Show it in a viewer that is already open, as 127.0.0.1:9876.",
            rich_help_panel=VIEWING,
        ),
    ] = None
    rerun: Annotated[
        Path | None,
        typer.Option(
            "--rerun", metavar="F.rrd", help="Write what the viewer shows to a file.", rich_help_panel=VIEWING
        ),
    ] = None

    def where(self, view: bool, *, keeps: bool = True) -> Any:
        """The place to show it, from these options. `keeps`: the command has the option --rerun.

        Raises:
            ViewerError: Two of them contradict each other, the viewer is not installed, or there is no display for it.
        """
        options = {"--viewer": self.viewer, "--web": self.web, "--rerun": self.rerun}
        asked = next((option for option, value in options.items() if value), "--view")
        extra = part("navloom_viewer.viewer_errors", asked, "'navloom[view]'")
        if self.viewer is not None and self.web:
            raise extra.ViewerError("--viewer and --web: choose the viewer that runs, or a new one")
        extra.need_rerun()
        opens = self.viewer is None and (view or self.web)
        if opens and not self.web:
            part("navloom_viewer.program").need_display(keeps)
        return part("navloom_viewer.viewer_session").Where(self.rerun, self.viewer, opens, self.web)


@dataclass(frozen=True)
class ViewOptions(ViewerOptions):
    """Whether a run is shown while it lasts, and where."""

    view: Annotated[bool, typer.Option("--view", help="Show it in the viewer.", rich_help_panel=VIEWING)] = False

    def asked(self) -> Any:
        """The place to show the run; None if none of the options is given. Raises ViewerError."""
        is_asked = self.view or self.web or self.viewer is not None or self.rerun is not None
        return self.where(self.view) if is_asked else None
