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
from navloom.engine.lockstep import PROGRESS_INTERVAL_NS, Observer
from navloom.engine.lockstep_builder import moving_world_of
from navloom.engine.nodes.world_node import mover_of
from navloom.engine.streams import WorldPorts
from navloom.engine.trace import TraceWriter
from navloom.geometry.moving_world import Mover
from navloom.messages import Bodies
from navloom.messages.codec import schema_label
from navloom.plugins import Discovery
from navloom.plugins.run_observers import Onlookers
from navloom.runs.episode import Drive, Episode, run_info
from navloom.runs.fleet_share import FleetError, Moved, Share, ShareProcess
from navloom.runs.shared_drives import drives_of

__all__ = ["Fleet", "FleetError", "load_fleet", "run_fleet"]


@dataclass(eq=False)
class Fleet:
    """A finished run of a fleet.

    Attributes:
        episodes: The episode of each member, by name.
        trace_sha256: Hash of what the world says and of the members' traces.
        wall_ns: Wall time from the first tick to the last.
        unheard: Members whose messages did not reach the observers that wanted them.
    """

    episodes: dict[str, Episode]
    trace_sha256: str
    wall_ns: int
    unheard: Sequence[str] = ()

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
    onlookers: Mapping[str, Onlookers] | None = None,
    observers: Mapping[str, Sequence[Observer]] | None = None,
    processes: int = 1,
) -> Fleet:
    """Run the configs of a fleet's members in one world, each until its last goal has ended and the robot stands.

    A member whose run has ended stands there for the others until theirs have.

    Args:
        members: The configs, from `load_fleet`.
        discovery: Plugins; default the installed ones, which further processes always use.
        traces: File for the trace of each member, by name; with a path if there are several processes.
        say: Receives progress of the preparation.
        progress: Called with the run time so far and the longest possible one, s.
        reads: Streams that metrics need, `(role or node, port)`, of each member.
        onlookers: Observers of plugins of each member, by name, as in `run_episode`. They get no messages of a member
            that another process drives.
        observers: Further observers of each member, by name; they need one process.
        processes: Number of processes that drive the members: this one and others. It changes no result.

    Raises:
        ConfigError, PluginError: The request was wrong; nothing ran.
        FleetError: A process has died.
    """
    onlookers = onlookers or {}

    def begin(drive: Drive) -> Sequence[Observer]:
        loaded = drive.system.loaded
        begun = onlookers[loaded.member].begin(run_info(loaded, "lockstep")) if loaded.member in onlookers else ()
        return [*(observers or {}).get(loaded.member, ()), *begun]

    drives, traces, reads = drives_of(members, discovery), traces or {}, list(reads)
    _check_world(drives)
    # Dealt in turn: neighbours in the file are often alike.
    shares = [dict(list(drives.items())[first::processes]) for first in range(min(processes, len(drives)))]
    with ExitStack() as within:
        others = [within.enter_context(ShareProcess(share, traces, reads)) for share in shares[1:]]
        own = within.enter_context(Share(shares[0], traces, say, reads, begin))
        for other in others:
            other.await_ready()
        unheard = [name for share in shares[1:] for name, drive in share.items() if begin(drive)]
        world = _World(drives)
        wall_ns = _run(world, own, others, progress)
        ended = own.finish()
        for other in others:
            ended |= other.finish(world.said)
    episodes = {name: ended[name] for name in drives}
    _share_contacts(episodes)
    hashed = hashlib.sha256(world.trace.sha256().encode())
    for name in sorted(episodes):
        hashed.update(f"\n{name} {episodes[name].log.trace_sha256}".encode())
    return Fleet(episodes, hashed.hexdigest(), wall_ns, unheard)


def _run(
    world: _World, own: Share, others: Sequence[ShareProcess], progress: Callable[[float, float], None] | None
) -> int:
    """Tick all until the last one has ended. Returns the wall time, ns."""
    started, told, number = perf_counter_ns(), 0, 0
    while world.driving:
        # From the truths of the previous tick: neither the order of the members nor their process changes anything.
        bodies = world.step(number)
        for other in others:
            other.begin_tick(number, bodies)
        moved = own.tick(number, bodies)
        for other in others:
            moved += other.end_tick()
        world.take(number, moved)
        number += 1
        now = perf_counter_ns()
        if progress is not None and now - told >= PROGRESS_INTERVAL_NS:
            told = now
            progress(number * world.period, world.time_limit)
    return perf_counter_ns() - started


class _World:
    """The node `world` of a fleet: one for all members, whose own nodes `world` publish what it says.

    Args:
        drives: The members, by name.

    Attributes:
        driving: Names of the members whose runs have not ended.
        said: What it said in each tick.
        trace: Trace of that.
        period: Length of a tick, s.
        time_limit: Longest run of a member, s.
    """

    def __init__(self, drives: Mapping[str, Drive]) -> None:
        systems = {name: drive.system for name, drive in drives.items()}
        self._world = moving_world_of(list(systems.values()))
        self.period = next(iter(systems.values())).config.run.period
        self.time_limit = max(system.time_limit for system in systems.values())
        starts = {name: system.true_start for name, system in systems.items()}
        # Where each is, by the newest truth; before the first, at its start.
        self._movers = {name: Mover(start.x, start.y, start.heading) for name, start in starts.items()}
        self.driving, self.said, self.trace = set(drives), list[Bodies](), TraceWriter()
        self._label = f"world main {WorldPorts.bodies.name} {schema_label(Bodies)}".encode()

    def step(self, number: int) -> Bodies:
        """What moves, before a tick."""
        time_ns = round(number * self.period * 1e9)
        bodies = self._world.advance(time_ns, list(self._movers.values()))
        self.said.append(bodies)
        self.trace.entries.append((self._label, bodies, (number, time_ns, time_ns, 0), "fleet/world/main/bodies"))
        self.trace.end_tick(number)
        return bodies

    def take(self, number: int, moved: Sequence[Moved]) -> None:
        """Take the truths of a tick; a robot that is no longer driven stands.

        Raises:
            ConfigError: Robots touch each other in the first tick.
        """
        truths = {name: truth for name, truth, _ in moved}
        for name in self._movers:
            truth = truths.get(name)
            if truth is not None:
                self._movers[name] = mover_of(truth)
                if number == 0 and truth.touching and truth.nearest in self._movers:
                    raise ConfigError(f"member {name}: start: touches {truth.nearest} there: move one of them")
        for name in [name for name, _, is_over in moved if is_over]:
            self.driving.remove(name)
            self._movers[name] = replace(self._movers[name], vx=0.0, vy=0.0, wz=0.0)


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
