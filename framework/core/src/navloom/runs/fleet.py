"""Runs a fleet: several robots in one world, each in lockstep with its own stack, all ticked in step."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from time import perf_counter_ns
from typing import IO, Any

from navloom.config import ConfigError, Loaded, load_config
from navloom.config.loader import members_of
from navloom.engine.build import is_simulated
from navloom.engine.lockstep import PROGRESS_INTERVAL_NS
from navloom.engine.lockstep_builder import moving_world_of
from navloom.engine.nodes.world_node import mover_of
from navloom.engine.plugin_factory import make_plugins
from navloom.engine.trace import TraceWriter
from navloom.geometry.moving_world import Mover
from navloom.messages import Bodies, Truth
from navloom.plugins import Discovery
from navloom.runs.episode import Drive, Episode

__all__ = ["Fleet", "load_fleet", "run_fleet"]


@dataclass(eq=False)
class Fleet:
    """A finished run of a fleet.

    Attributes:
        episodes: The episode of each member, by name.
        trace_sha256: Hash of what the world says and of the members' traces.
        wall_ns: Wall time from the first tick to the last.
    """

    episodes: dict[str, Episode]
    trace_sha256: str
    wall_ns: int

    def summary(self) -> dict[str, Any]:
        """The object that `run --json` prints: that of each member by name, and what the fleet has as a whole."""
        members = {name: episode.summary() for name, episode in self.episodes.items()}
        return {
            "trace_sha256": self.trace_sha256,
            "wall_s": self.wall_ns * 1e-9,
            "sim_time_s": max(member["sim_time_s"] for member in members.values()),
            "reached": sum(episode.trail.succeeded for episode in self.episodes.values()),
            **{
                name: sum(member[name] or 0 for member in members.values())
                for name in ("collisions", "own_contacts", "others_contacts")
            },
            "members": members,
        }


def load_fleet(
    reference: str,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    shadows: Sequence[str] = (),
    method: str = "",
) -> list[Loaded]:
    """The config of each member of a config with `[[member]]`; for the arguments see `load_config`.

    Raises:
        ConfigError: A member's config does not fit, or the members do not share a world and a period.
    """
    names = members_of(reference)
    members = [load_config(reference, overrides, seed, shadows, method, name) for name in names]
    for loaded in members[1:]:
        for (place, value), (_, other) in zip(_shared(loaded), _shared(members[0]), strict=True):
            if value != other:
                raise ConfigError(
                    f"{loaded.name}: {place}: is another one than that of {members[0].member}, but members share it: "
                    "give it beside [[member]]"
                )
    return members


def _shared(loaded: Loaded) -> list[tuple[str, Any]]:
    """Places and values that all members share; of a world also the folder of its files."""
    config = loaded.config
    world = None if config.world is None else (config.world.ref, loaded.base_of("world.ref").absolute())
    actors = [event for event in config.event if event.do == "actor"]
    return [("run.period", config.run.period), ("world.ref", world), ("event (actors)", actors)]


def run_fleet(
    members: Sequence[Loaded],
    *,
    discovery: Discovery | None = None,
    traces: Mapping[str, IO[bytes]] | None = None,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, float], None] | None = None,
    reads: Iterable[tuple[str, str]] = (),
) -> Fleet:
    """Run the configs of a fleet's members in one world, each until its last goal has ended and the robot stands.

    A member whose run has ended stands there for the others until theirs have.

    Args:
        members: The configs, from `load_fleet`.
        discovery: Plugins; default the installed ones.
        traces: File for the trace of each member, by name.
        say: Receives progress of the preparation.
        progress: Called with the run time so far and the longest possible one, s.
        reads: Streams that metrics need, `(role or node, port)`, of each member.

    Raises:
        ConfigError, PluginError: The request was wrong; nothing ran.
    """
    drives = {loaded.member: Drive(loaded, discovery) for loaded in members}
    _check_world(drives)
    with ExitStack() as within:
        for name, drive in drives.items():
            within.enter_context(drive)
            make_plugins(drive.system, say)
            drive.connect((), (traces or {}).get(name), reads=reads)
        world = _World(list(drives.values()))
        wall_ns = _run(drives, world, progress)
    episodes = {name: drive.episode() for name, drive in drives.items()}
    _share_contacts(episodes)
    hashed = hashlib.sha256(world.trace.sha256().encode())
    for name in sorted(episodes):
        hashed.update(f"\n{name} {episodes[name].log.trace_sha256}".encode())
    return Fleet(episodes, hashed.hexdigest(), wall_ns)


def _run(drives: Mapping[str, Drive], world: _World, progress: Callable[[float, float], None] | None) -> int:
    """Tick all until the last one has ended. Returns the wall time, ns."""
    started, told, number = perf_counter_ns(), 0, 0
    driving = list(drives.values())
    limit, period = max(drive.system.time_limit for drive in driving), driving[0].system.config.run.period
    try:
        while driving:
            # From the truths of the previous tick: the order of the members changes nothing.
            world.step(number, driving)
            over = {id(drive) for drive in driving if drive.executor.tick(number)}
            if number == 0:
                _check_starts(drives)
            number += 1
            driving = [drive for drive in driving if id(drive) not in over and number < drive.system.longest_run]
            now = perf_counter_ns()
            if progress is not None and now - told >= PROGRESS_INTERVAL_NS:
                told = now
                progress(number * period, limit)
    finally:
        for drive in drives.values():
            drive.executor.trace.flush()
        world.trace.flush()
    for drive in drives.values():
        drive.executor.finish(sum(drive.executor.log.tick_ns))
    return perf_counter_ns() - started


class _World:
    """The node `world` of a fleet: one for all members, whose own nodes `world` publish what it says.

    Args:
        drives: The members.

    Attributes:
        trace: Trace of what it says.
    """

    def __init__(self, drives: Sequence[Drive]) -> None:
        self._drives, self._world = list(drives), moving_world_of([drive.system for drive in drives])
        self._slots = [drive.executor.active("world").slots["bodies"] for drive in drives]
        self._period, self._label = drives[0].system.config.run.period, self._slots[0].label(Bodies)
        self.trace = TraceWriter()

    def step(self, number: int, driving: Sequence[Drive]) -> None:
        """Publish, before a tick, what moves; a robot that is no longer driven stands."""
        time_ns = round(number * self._period * 1e9)
        bodies = self._world.advance(time_ns, [_mover(drive, drive in driving) for drive in self._drives])
        when = (number, time_ns, time_ns, 0)
        for drive, slot in zip(self._drives, self._slots, strict=True):
            if drive in driving:
                slot.put(bodies, slot.sequence + 1, when, number)
        self.trace.entries.append((self._label, bodies, when, "fleet/world/main/bodies"))
        self.trace.end_tick(number)


def _truth(drive: Drive) -> Truth | None:
    truth = drive.executor.active("platform").slots["truth"].message
    assert truth is None or isinstance(truth, Truth)
    return truth


def _mover(drive: Drive, is_driving: bool) -> Mover:
    """Where a member is, by the newest truth; before the first, at its start."""
    truth, start = _truth(drive), drive.system.true_start
    if truth is None:
        return Mover(start.x, start.y, start.heading)
    return mover_of(truth) if is_driving else replace(mover_of(truth), vx=0.0, vy=0.0, wz=0.0)


def _share_contacts(episodes: Mapping[str, Episode]) -> None:
    """Give each member the contacts of those that drove into it: they stay where they were, short of its outline."""
    reported = {name: list(episode.recorder.contacts) for name, episode in episodes.items()}
    for name, episode in episodes.items():
        recorder, rows = episode.recorder, {row for row, _ in reported[name]}
        for other, contacts in reported.items():
            for row, touched in contacts:
                if touched == name and row not in rows and row < len(recorder.truth):
                    rows.add(row)
                    recorder.contacts.append((row, other))
        recorder.contacts.sort(key=lambda contact: contact[0])
        recorder.touches = sum(row - 1 not in rows for row in rows)


def _check_world(drives: Mapping[str, Drive]) -> None:
    """Refuse members without a simulated world."""
    for name, drive in drives.items():
        system = drive.system
        if system.world is None or not is_simulated(system.parts["platform", system.config.platform.instance]):
            raise ConfigError(f"member {name}: has no simulated world, which members share: give [world] ref")


def _check_starts(drives: Mapping[str, Drive]) -> None:
    """Refuse robots that touch each other in the first tick."""
    for name, drive in drives.items():
        truth = _truth(drive)
        if truth is not None and truth.touching and truth.nearest in drives:
            raise ConfigError(f"member {name}: start: touches {truth.nearest} there: move one of them")
