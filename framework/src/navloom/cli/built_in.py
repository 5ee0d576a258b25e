"""The commands of navloom itself, as the help lists them."""

from __future__ import annotations

from importlib import import_module
from typing import Any, NamedTuple

from navloom.cli.lazy import LazyCommand, made_by_typer

__all__ = ["BUILT_IN", "BuiltIn", "BuiltInCommand"]


class BuiltIn(NamedTuple):
    """A command of navloom.

    Attributes:
        name: Name of the command, typed after `navloom`.
        source: Its function or its app of commands, as MODULE:NAME below `navloom.cli`.
        help: First sentence of its help.
        settings: Its further settings for `Typer.command`, as MODULE:NAME; empty if it has none.
    """

    name: str
    source: str
    help: str
    settings: str = ""


BUILT_IN = (
    BuiltIn("run", "study.run:run", "Run a config in simulated time, in one process (lockstep)."),
    BuiltIn(
        "compare",
        "study.compare:compare",
        "Run methods over worlds and seeds in closed loop.",
        "study.compare:VARIADIC",
    ),
    BuiltIn("report", "study.report:report", "Write the report of a study into its folder."),
    BuiltIn("up", "live.up:up", "Start a live robot and drive it to the config's goal."),
    BuiltIn("down", "live.up:down", "Shut down a robot on this host."),
    BuiltIn("goal", "live.operate:goal", "Send a live robot to a goal and show its progress.", "live.operate:NUMBERS"),
    BuiltIn("cancel", "live.operate:cancel", "Cancel the goal of a live robot."),
    BuiltIn("place", "live.operate:place", "Tell a live robot where it is.", "live.operate:NUMBERS"),
    BuiltIn("swap", "live.operate:swap", "Make another instance of a role active, also during a drive."),
    BuiltIn("stop", "live.operate:stop", "Stop a live robot until `navloom resume`; its goal waits."),
    BuiltIn("resume", "live.operate:resume", "Let a robot drive again after a stop, a contact or teleop."),
    BuiltIn(
        "teleop",
        "live.teleop:teleop",
        "Drive a live robot by hand, within the limits of the gate.",
        "live.operate:NUMBERS",
    ),
    BuiltIn("list", "live.listing:list_nodes", "Print every node of a live robot with its state."),
    BuiltIn("status", "live.status:status", "Print what a live robot is doing, or why it is stopped."),
    BuiltIn("echo", "live.echo:echo", "Print the messages of a stream as they arrive, until Ctrl-C."),
    BuiltIn("hz", "live.hz:hz", "Print rate, jitter, age and bandwidth of streams."),
    BuiltIn("metrics", "live.metrics:metrics", "Serve a live robot's metrics to Prometheus, until Ctrl-C."),
    BuiltIn("doctor", "live.doctor:doctor", "Find problems of a live robot or its network, with remedies."),
    BuiltIn("node", "live.nodes:node", "Run chosen nodes of a robot here, until Ctrl-C."),
    BuiltIn("router", "live.nodes:router", "Run the router that links a robot's hosts, until Ctrl-C."),
    BuiltIn("record", "recordings.record:record", "Record a live robot into one MCAP file, until Ctrl-C."),
    BuiltIn("replay", "recordings.replay:replay", "Replay a recording, or try another plugin on its inputs."),
    BuiltIn("import", "recordings.import_log:import_log", "Import a CARMEN log with laser scans and odometry."),
    BuiltIn("view", "recordings.view:view", "Show a live robot until Ctrl-C, or a recording."),
    BuiltIn("plan", "study.plan:plan", "Plan one path on one map."),
    BuiltIn("map", "study.map:map_recording", "Map one recorded sweep of a pitched laser."),
    BuiltIn("plugins", "describing.plugins:plugins", "List plugins, show one or its role, or generate a new one."),
    BuiltIn("messages", "describing.messages:messages", "List every message, or show the fields of one."),
    BuiltIn("check", "study.check:check", "Check one plugin in a separate process."),
    BuiltIn("worlds", "describing.worlds:worlds", "List the named worlds and the schemes for world files."),
    BuiltIn("graph", "describing.graph:graph", "Print the nodes in the order they step, and their inputs."),
    BuiltIn("completion", "shells.completion:completion", "Print a completion script for bash, zsh or fish."),
    BuiltIn("man", "shells.manual:man", "Print the manual page."),
    BuiltIn("params", "live.operate:params", "Parameters of a live robot's plugins."),
    BuiltIn("keys", "live.keys:app", "Make, renew and revoke the certificates of a robot."),
    BuiltIn("export", "live.export:app", "Write systemd units or a compose file for a robot."),
    BuiltIn("config", "describing.config:app", "Show, check and describe configs."),
)
"""Every command, in the order of the help."""


class BuiltInCommand(LazyCommand):
    """A command of navloom."""

    def __init__(self, entry: BuiltIn) -> None:
        super().__init__(entry.name, help=entry.help)
        self._entry = entry

    def made(self) -> Any:
        """The real command, with its options."""
        settings = _object(self._entry.settings) if self._entry.settings else {}
        return made_by_typer(self._entry.name, _object(self._entry.source), **settings)


def _object(reference: str) -> Any:
    """What MODULE:NAME below `navloom.cli` refers to."""
    module, _, name = reference.partition(":")
    return getattr(import_module(f"navloom.cli.{module}"), name)
