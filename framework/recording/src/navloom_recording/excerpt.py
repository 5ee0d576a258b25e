"""The part of a recording to replay: one node, up to one tick, with a debugger in the last step."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from pdb import Pdb
from typing import Any

from navloom.config import ConfigError
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import STEP
from navloom.messages import StepReport
from navloom.plugins.registry import nearest
from navloom.roles import ROLES, Role, verb_of

from navloom_recording.reader import Recording

__all__ = ["SOURCES", "Act", "DebuggerLeft", "Excerpt", "excerpt_of", "repeating", "stop_inside"]

SOURCES = frozenset({"operator", "platform"})
"""Roles that are not replayed: their recorded messages are the inputs of the others."""
Source = tuple[str, str]
Act = Callable[[Tick], None]
MOST_NAMED = 12
"""Most nodes that a message lists."""


@dataclass(frozen=True)
class Excerpt:
    """The part to replay.

    Attributes:
        only: Role and instance of the only node to step; None for all.
        until: Tick of the last step; None for the end of the recording.
        is_debugged: Whether a debugger stops inside the last step.
    """

    only: Source | None = None
    until: int | None = None
    is_debugged: bool = False

    def has(self, source: Source, tick: int) -> bool:
        """Whether a step belongs to this part."""
        return (self.only is None or source == self.only) and (self.until is None or tick <= self.until)

    def debugs(self, tick: int) -> bool:
        """Whether a debugger stops inside a step of this tick."""
        return self.is_debugged and tick == self.until


# No `Exception`, or the stepper would take it for a fault of the plugin.
class DebuggerLeft(BaseException):
    """The user quit the debugger, which ends the replay."""


def excerpt_of(recording: Recording, only: str | None, until: int | None, is_debugged: bool) -> Excerpt:
    """The part that a user requests.

    Args:
        recording: The recording.
        only: ROLE, or ROLE.NAME if a role has several instances; None for all.
        until: Tick of the last step.
        is_debugged: Whether a debugger stops inside the step of that tick.

    Raises:
        ConfigError: There is no such node or step, or there are several.
    """
    if is_debugged and until is None:
        raise ConfigError("--pdb: expected --until TICK too, the tick of the step in which the debugger stops")
    if only is None and not is_debugged:
        return Excerpt(None, until)
    steps = _steps(recording, until)
    if only is not None:
        source = _source_of(only, {source for source, _, _ in steps})
        ticks = [tick for one, tick, _ in steps if one == source]
        if until is not None and until not in ticks:
            raise ConfigError(f"--until {until}: {'.'.join(source)} made no step in that tick; {_spread(ticks, until)}")
        return Excerpt(source, until, is_debugged)
    last = [(source, fault) for source, tick, fault in steps if tick == until]
    failed = [source for source, fault in last if fault]
    # One that failed in that tick is what a user wants to look into.
    if len(failed) != 1:
        names = ", ".join(".".join(source) for source, _ in last[:MOST_NAMED]) or "none"
        raise ConfigError(f"--pdb: choose a node by --only; those that stepped in tick {until}: {names}")
    return Excerpt(failed[0], until, True)


def _steps(recording: Recording, until: int | None) -> list[tuple[Source, int, str]]:
    """Every recorded step up to a tick: its node, tick and fault."""
    found = []
    for message in recording.messages([f"*/*/{STEP}"]):
        report, tick = message.message, message.envelope.tick
        if isinstance(report, StepReport) and report.trigger and (until is None or tick <= until):
            role, name = message.envelope.key.split("/")[-3:-1]
            if role not in SOURCES:
                found.append(((role, name), tick, report.fault))
    return found


def _source_of(only: str, known: Iterable[Source]) -> Source:
    """The node that `ROLE` or `ROLE.NAME` means."""
    role, dot, name = only.partition(".")
    if role in SOURCES:
        raise ConfigError(f"--only {only}: what the {role} said is the input of a replay; choose another node")
    found = sorted(source for source in known if source[0] == role and (not dot or source[1] == name))
    if len(found) == 1:
        return found[0]
    if found:
        raise ConfigError(f"--only {only}: there are {' and '.join('.'.join(one) for one in found)}; choose one")
    names = sorted({role for role, _ in known} | {".".join(source) for source in known})
    raise ConfigError(f"--only {only}: no such node stepped{nearest(only, names)}")


def _spread(ticks: Sequence[int], until: int) -> str:
    """The nearest step before the requested one, in words."""
    if not ticks:
        return f"it made none up to tick {until}"
    return f"the step before was in tick {max(ticks)}"


def repeating(path: Path, role: str, name: str, tick: int, is_only: bool) -> str:
    """The command that repeats one step of a recording.

    Args:
        path: Path of the recording.
        role, name: Role and instance of the node.
        tick: Tick of the step.
        is_only: Whether the role has no other instance.
    """
    node = role if is_only else f"{role}.{name}"
    return f"navloom replay {shlex.quote(str(path))} --only {shlex.quote(node)} --until {tick} --traceback"


class _Debugger(Pdb):
    """Python's debugger; it remembers that the user quit."""

    has_left = False

    def set_quit(self) -> None:
        """Remember that the user quit."""
        self.has_left = True
        super().set_quit()

    def call(self, act: Callable[..., Any], *given: Any) -> Any:
        """Call a function with a breakpoint at its first line, and return its result. Raises DebuggerLeft."""
        answer = self.runcall(act, *given)
        if self.has_left:
            raise DebuggerLeft
        return answer


def stop_inside(node: Node, act: Act) -> Act:
    """Wrap `act`: a debugger stops at the first line of the plugin's verb, or of a framework node's step."""
    debugger, plugin = _Debugger(), getattr(node, "plugin", node)
    if not isinstance(plugin, Role) or plugin.role not in ROLES:
        return lambda tick: debugger.call(act, tick)
    verb = verb_of(plugin.role)
    method = getattr(plugin, verb)

    def debugged(tick: Tick) -> None:
        # On the object: its class may serve other instances, and `del` brings the method back.
        vars(plugin)[verb] = lambda *given: debugger.call(method, *given)
        try:
            act(tick)
        finally:
            del vars(plugin)[verb]

    return debugged
