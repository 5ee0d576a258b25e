"""Hooks that a plugin module may implement, and their marker."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import pluggy

if TYPE_CHECKING:
    from navloom.messages import Envelope, Message
    from navloom.plugins.registry import Registry

__all__ = ["HookSpecs", "MessageObserver", "RunInfo", "hookimpl", "hookspec"]

hookspec = pluggy.HookspecMarker("navloom")
hookimpl = pluggy.HookimplMarker("navloom")


@dataclass(frozen=True)
class RunInfo:
    """A run, as observers get it.

    Attributes:
        kind: "lockstep" for `navloom run`, "barrier" for `navloom up --barrier`, "live" for `navloom up`.
        name: Name of the config, as it was given.
        config: The whole config with its defaults, as plain values; each observer gets a copy.
        config_sha256: Hash of the config.
        realm, robot: Names of the robot.
        seed: Seed of every random stream.
    """

    kind: Literal["lockstep", "barrier", "live"]
    name: str
    config: dict[str, Any]
    config_sha256: str
    realm: str
    robot: str
    seed: int


class MessageObserver(Protocol):
    """What `navloom_observe` may return: an object that gets the messages of one run.

    Attributes:
        wants: Pairs of role and port whose messages it gets; None for every message.
    """

    @property
    def wants(self) -> Set[tuple[str, str]] | None:
        """See above."""

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """A message was published.

        Args:
            role, instance, port: Where it was published.
            active: Whether its instance is the active one of its role.
            message: The message.
            at: Its envelope: sequence, tick and stamps.
        """


class HookSpecs:
    """The hooks that a plugin module may implement. Hooks register and report; control never goes through one.

    `navloom_register` is called in each entry point, alone, when its name is first needed. The others are called in
    every entry point `observer.NAME`, one after the other, in each `navloom run` and `navloom up`. An implementation
    gets the arguments that it names. One that raises is reported once, with its distribution, file and line, and is
    not called again in the run.
    """

    @hookspec
    def navloom_register(self, registry: Registry) -> None:
        """Add classes, nodes, messages, worlds, schemes, metrics, viewer panels, suites or commands to the registry."""

    @hookspec
    def navloom_run_started(self, run: RunInfo) -> None:
        """A run begins: its plugins are created, and nothing has moved yet. In a live run every node is up."""

    @hookspec
    def navloom_observe(self, run: RunInfo) -> MessageObserver | None:
        """Return an object that receives the messages of this run, or None to ignore it."""

    @hookspec
    def navloom_run_finished(self, run: RunInfo, summary: Mapping[str, Any] | None, episode: Any, out: Any) -> None:
        """A run has ended.

        Args:
            run: The same as at the start.
            summary: What `--json` prints; None if the run was cut short, or no goal has ended.
            episode: The run, a `navloom.runs.Episode`; None with the summary.
            out: The folder of `--out`, a `navloom.runs.OutFolder`, to write further files to; None without one.
        """
