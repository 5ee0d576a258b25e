"""Services of a process's nodes: goals, stops, swaps, parameters, and descriptions of the nodes."""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import platform
import threading
import time
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from navloom.config import ConfigError, Loaded
from navloom.engine.changes import changed_params
from navloom.engine.checks import place_problem
from navloom.engine.door import notes_of
from navloom.engine.making import configure
from navloom.engine.nodes.localizer import LocalizerNode
from navloom.engine.system import System
from navloom.entry_kinds import TRACEBACK
from navloom.inputs.texts import refuse_deep_toml
from navloom.messages import Goal, OperatorRequest, Parameters, Point2D, Pose2D
from navloom.plugins.blame import kept_tracebacks
from navloom.plugins.registry import nearest
from navloom.runs.provenance import distributions

from navloom_live.hosting.process_warnings import ProcessWarnings
from navloom_live.live.cell import Source
from navloom_live.live.cells import Hosted, all_sources
from navloom_live.live.live import LiveRunner
from navloom_live.live.live_gate import LiveGate
from navloom_live.live.live_goal import LiveGoal
from navloom_live.live.live_platform import LivePlatform
from navloom_live.live.memory import Memory
from navloom_live.live.placing import spread
from navloom_live.live.run_clock import RunClock
from navloom_live.live.switchboard import Switchboard
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.once import Once
from navloom_live.transport.questions import Desk, KeptJson, QuestionError, read_question
from navloom_live.transport.zenoh_bus import Bus, Question

__all__ = ["Handler", "ServiceError", "Services"]

APPLY = 2.0
"""How long a node may take to begin with a change, s."""

USUAL = 64
"""Number of steps whose median is reported as the usual duration."""
FEW_CHAINS = 100
"""Fewest ticks for statistics on how long their commands take."""

Handler = Callable[[dict[str, Any]], dict[str, Any]]


class ServiceError(QuestionError):
    """A request that is refused. The text says why."""


class Services:
    """Answers for the nodes of one process, on threads of its own."""

    def __init__(
        self,
        system: System,
        process: str,
        keys: KeySpace,
        bus: Bus,
        hosted: Mapping[Source, Hosted],
        live: Mapping[Source, LiveRunner],
        memory: Memory,
        clock: RunClock,
        board: Switchboard,
        warnings: ProcessWarnings,
    ) -> None:
        self._system, self._process, self._keys, self._bus = system, process, keys, bus
        self._hosted, self._live, self._memory, self._clock, self._board = hosted, live, memory, clock, board
        self._warnings = warnings
        self._desk, self._once = Desk(), Once()
        self._goals = threading.Lock()
        self._began = time.monotonic()
        self._kept_config: tuple[Loaded | None, bytes] = (None, b"")

    def offer(self, extend: Handler | None = None) -> None:
        """Declare all services of this process; `extend` tells its nodes of an instance that the robot gains."""
        for source in self._hosted:
            self._offer_description(source)
            if source in self._system.parts:
                self._serve(source, "params/get", lambda given, source=source: self._get(source))  # type: ignore[misc]
        for source, runner in self._live.items():
            if source in self._system.parts:
                self._serve(source, "params/set", lambda given, source=source: self._set(source, given))  # type: ignore[misc]
            if source[0] == "localizer":
                self._serve(source, "place", lambda given, runner=runner: self._place(runner, given))  # type: ignore[misc]
            if isinstance(runner, LiveGoal):
                self._serve(source, "submit", lambda given, runner=runner: self._submit(runner, given))  # type: ignore[misc]
                self._serve(source, "cancel", lambda given, runner=runner: self._cancel(runner))  # type: ignore[misc]
                self._serve(source, "replan", lambda given, runner=runner: self._replan(runner))  # type: ignore[misc]
            if isinstance(runner, LiveGate):
                self._serve(source, "swap", lambda given, runner=runner: self._swap(runner, given))  # type: ignore[misc]
                for do in ("stop", "resume", "release", "enter_unseen"):
                    self._serve(source, do, lambda given, runner=runner, do=do: self._gate(runner, do))  # type: ignore[misc]
        if self._live:
            recalled = KeptJson(lambda: vars(self._memory), lambda: {"clock_ns": self._clock.now_ns()})
            self._show(self._keys.process(self._process, "memory"), "memory", recalled.to_bytes)
            self._show(self._keys.process(self._process, "steps"), "steps", self._step_times)
        if extend is not None:
            self._serve(("process", self._process), "extend", extend)
        self._show(self._keys.process(self._process, "config"), "config", self._config)
        self._show(self._keys.process(self._process, "warnings"), "warnings", self._listed_warnings)
        if os.environ.get(TRACEBACK):
            self._show(self._keys.process(self._process, "tracebacks"), "tracebacks", _tracebacks)

    def _serve(self, source: Source, service: str, handler: Handler) -> None:
        """Serve queries that carry a JSON object: a handler turns it into the answer."""
        key, handler = self._keys.port(*source, service), self._once.guard(handler)

        def handle(question: Question) -> None:
            try:
                answer = handler(read_question(question.data))
            except (QuestionError, ConfigError) as error:
                question.refuse(str(error))
            else:
                question.answer(key, json.dumps(answer).encode(), "json")

        self._bus.serve(key, self._desk.window(service, handle))

    def _show(self, key: str, service: str, made: Callable[[], bytes]) -> None:
        """Serve queries that carry no data."""
        self._bus.serve(key, self._desk.window(service, lambda question: question.answer(key, made(), "json")))

    def _config(self) -> bytes:
        """The whole config, for recordings: only the running process knows what it runs."""
        loaded = self._system.loaded
        if self._kept_config[0] is not loaded:
            given = {
                "loaded": loaded.to_json(),
                "barrier": self._board.lossless,
                "distributions": distributions(loaded.config),
            }
            self._kept_config = loaded, json.dumps(given).encode()
        return self._kept_config[1]

    def _listed_warnings(self) -> bytes:
        """The process's warnings."""
        cells = {source: hosted.cell for source, hosted in self._hosted.items()}
        return json.dumps([one.to_json() for one in self._warnings.listed(cells, self._live)]).encode()

    def _step_times(self) -> bytes:
        """(tick, ns) of the newest steps of each node, by "role instance"."""
        return json.dumps({" ".join(source): runner.times.newest() for source, runner in self._live.items()}).encode()

    # --- what they are ----------------------------------------------------------------------------------------------

    def _offer_description(self, source: Source) -> None:
        described = KeptJson(lambda: self._describe(source), self._clocks)
        self._show(self._keys.port(*source, "describe"), "describe", described.to_bytes)

    def _clocks(self) -> dict[str, Any]:
        """This host's clocks, for comparison by others; never cached."""
        return {"clock_ns": self._clock.now_ns(), "wall_ns": time.time_ns()}

    def _describe(self, source: Source) -> dict[str, Any]:
        cell = self._hosted[source].cell
        part = self._system.parts.get(source)
        streams: dict[str, Any] = {}
        for feed in cell.feeds:
            key = feed.inlet.key.removeprefix(f"{self._keys.prefix}/")
            streams[key] = feed.inlet.counts.summary() | {"latest": feed.inlet.keeps_latest}
        runner, now = self._live.get(source), time.monotonic()
        since_ns = cell.stepper.busy_since_ns
        return {
            "role": source[0],
            "instance": source[1],
            "plugin": part.table.plugin if part is not None else None,
            "process": self._process,
            "pid": os.getpid(),
            "host": platform.node(),
            "active": cell.stepper.active,
            "enabled": cell.stepper.enabled,
            "tick": cell.stepper.stepped,
            "epoch": cell.epoch,
            "versions": _versions(),
            "config_sha256": self._system.loaded.sha256(),
            "silence_s": self._clock.silence_s() if self._clock.is_known else None,
            "up_s": now - self._began,
            "period_s": self._system.config.run.period * cell.stepper.stride,
            "step_s": _usual(runner),
            "busy_s": None if since_ns is None else max(0.0, now - since_ns * 1e-9),
            "faulted": runner.faulted if runner is not None else 0,
            "fault": runner.fault if runner is not None else "",
            "notes": [f"{' '.join(source)} {note}" for note in notes_of(cell.node)],
            "shares_memory": self._system.config.live.shared_memory,
            "waits_for": list(cell.stepper.lacks),
            "is_patient": self._system.catalogue.is_patient(source[0]),
            "shared_memory_mb": shared_memory_mb(),
            "published": {port: outlet.sequence for port, outlet in cell.outlets.items()},
            "carries": {port: outlet.carries for port, outlet in cell.outlets.items()},
            "streams": streams,
            "places": self._places(),
            "hosts": {process: host for host, share in self._system.config.live.hosts.items() for process in share},
            **_punctuality(runner),
        }

    def _places(self) -> dict[str, str]:
        """Process of each node, by "role instance"."""
        shares = spread(self._system.config, all_sources(self._system), None)
        return {" ".join(source): process for process, share in shares.items() for source in share}

    def _get(self, source: Source) -> dict[str, Any]:
        plugin, version = self._system.plugin(*source), self._hosted[source].cell.versions
        return {"version": version, "values": plugin.params.model_dump(mode="json")}

    # --- what they do -----------------------------------------------------------------------------------------------

    def _set(self, source: Source, given: dict[str, Any]) -> dict[str, Any]:
        """Check all values, then let the node take them between two steps."""
        values = tuple(str(value) for value in given["values"])
        _refuse_doubles(values)
        changed_params(self._system, *source, values)
        runner = self._live[source]

        def apply() -> None:
            configure(self._system, *source, values)
            cell = runner.cell
            cell.versions += 1
            known = {_name(value): value for value in self._memory.parameters.get(" ".join(source), (0, ()))[1]}
            known |= {_name(value): value for value in values}
            changed = Parameters(cell.versions, tuple(known[name] for name in sorted(known)))
            self._memory.parameters[" ".join(source)] = (cell.versions, changed.values)
            tick = max(0, self._clock.tick)
            stamp = max(0, self._clock.stamp_ns)
            cell.outlets["parameters"].publish(changed, tick, stamp, stamp, cell.epoch)

        self._apply(runner, apply)
        return self._get(source)

    def _submit(self, runner: LiveGoal, given: dict[str, Any]) -> dict[str, Any]:
        x, y, heading = _number(given, "x"), _number(given, "y"), given.get("heading")
        heading = None if heading is None else math.remainder(_number(given, "heading"), math.tau)
        via = tuple(Point2D(float(px), float(py)) for px, py in given.get("via", ()))
        limit = time.monotonic() + APPLY
        while not self._clock.is_known and time.monotonic() < limit:
            time.sleep(0.02)
        if not self._clock.is_known:
            raise ServiceError("rejected: the platform has not been heard yet")
        problem = place_problem(self._system, x, y, heading)
        if problem:
            raise ServiceError(f"rejected: {problem}")
        with self._goals:
            number = self._memory.last_goal + 1
            self._memory.last_goal = number
        goal = Goal(number, x, y, heading, via)
        self._apply(
            runner, lambda: runner.submit(OperatorRequest("goal", goal)), patience=max(0.0, limit - time.monotonic())
        )
        return {"goal_id": number}

    def _place(self, runner: LiveRunner, given: dict[str, Any]) -> dict[str, Any]:
        """Set a localizer's pose."""
        node = runner.cell.node
        assert isinstance(node, LocalizerNode)
        x, y, heading = (_number(given, name) for name in ("x", "y", "heading"))
        problem = place_problem(self._system, x, y, heading)
        if "outside" in problem:
            raise ServiceError(problem)
        self._apply(runner, lambda: node.plugin.place(Pose2D(x, y, math.remainder(heading, math.tau))))
        return {"placed": True, "warning": problem}

    def _replan(self, runner: LiveGoal) -> dict[str, Any]:
        """Plan again from where the localizer now says that the robot is."""
        self._apply(runner, lambda: runner.submit(OperatorRequest("place")))
        return {"goal_id": runner.goal.machine.goal_id}

    def _cancel(self, runner: LiveGoal) -> dict[str, Any]:
        number = runner.goal.machine.goal_id
        self._apply(runner, lambda: runner.submit(OperatorRequest("cancel")))
        return {"goal_id": number}

    def _swap(self, runner: LiveGate, given: dict[str, Any]) -> dict[str, Any]:
        role, name = str(given["role"]), str(given["instance"])
        names = [known for owner, known in self._system.parts if owner == role]
        if role == "platform" or not names:
            roles = sorted({owner for owner, _ in self._system.parts} - {"platform"})
            raise ServiceError(f"{role!r} is no role that can be swapped{nearest(role, roles)}")
        if name not in names:
            raise ServiceError(
                f"there is no {role} {name!r}; there are {', '.join(names)}; start the robot with "
                f"`navloom up CONFIG --shadow {role}={name}` to add one"
            )
        self._apply(runner, lambda: runner.obey(OperatorRequest("swap", None, role, name)))
        return {"pending": runner.gate.pending, "selected": runner.gate.selected[role], "epoch": runner.gate.epoch}

    def _gate(self, runner: LiveGate, do: str) -> dict[str, Any]:
        self._apply(runner, lambda: runner.obey(OperatorRequest(do)), waits=do == "stop")  # type: ignore[arg-type]
        return {"done": do}

    def _apply(
        self, runner: LiveRunner, change: Callable[[], None], waits: bool = False, patience: float = APPLY
    ) -> None:
        """Run a change on a node's own thread, and wait for it.

        Args:
            runner: Runner of the node.
            change: The change.
            waits: After a timeout the change stays scheduled. Otherwise it is cancelled.
            patience: Longest wait, s.

        Raises:
            ServiceError: The node did not finish the change in time, or the change failed.
        """
        begun, done, failure = threading.Lock(), threading.Event(), []

        def do() -> None:
            if begun.acquire(blocking=False):
                try:
                    change()
                except Exception as error:
                    failure.append(error)
                done.set()

        runner.change(do)
        if not done.wait(patience):
            node = " ".join(runner.cell.source)
            if waits or not begun.acquire(blocking=False):
                raise ServiceError(
                    f"{node} has been in one step for {patience:.1f} s: the request is done when this step ends"
                )
            raise ServiceError(f"{node} has been in one step for {patience:.1f} s: nothing was changed; try again")
        if failure:
            raise ServiceError(str(failure[0]))


def _tracebacks() -> bytes:
    return json.dumps(kept_tracebacks()).encode()


def _usual(runner: LiveRunner | None) -> float | None:
    """Median duration of the newest steps, s; None before the first."""
    steps = sorted(spent for _, spent in runner.times.newest(USUAL)) if runner is not None else []
    return steps[len(steps) // 2] * 1e-9 if steps else None


def _punctuality(runner: LiveRunner | None) -> dict[str, float]:
    """For a platform, late ticks and stops; for a gate, how long a tick's commands take to arrive."""
    if isinstance(runner, LivePlatform):
        own = {"driven_ticks": runner.driven, "own_ticks": runner.own}
        return {"ticks": runner.ticks, "late_ticks": runner.late, "stops": runner.stops, **own}
    if isinstance(runner, LiveGate) and len(runner.chains_s) >= FEW_CHAINS:
        chains = sorted(runner.chains_s.copy())
        return {"chain_p50_s": chains[len(chains) // 2], "chain_p99_s": chains[len(chains) * 99 // 100]}
    return {}


def shared_memory_mb() -> float | None:
    """Free shared memory of this host, MiB, which large messages between its processes need; None without any."""
    try:
        status = os.statvfs("/dev/shm")
    except OSError:
        return None
    return status.f_bavail * status.f_frsize / 2**20


def _number(given: Mapping[str, Any], name: str) -> float:
    value = given[name]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise ServiceError(f"rejected: {name} is {value!r}, expected a finite number")
    return float(value)


def _name(assignment: str) -> str:
    return assignment.partition("=")[0].strip()


def _refuse_doubles(values: tuple[str, ...]) -> None:
    refuse_deep_toml("\n".join(values), "parameters", ServiceError)
    try:
        tomllib.loads("\n".join(values))
    except tomllib.TOMLDecodeError as error:
        raise ServiceError(f"parameters {', '.join(values)}: not TOML assignments: {error}") from None


@cache
def _versions() -> dict[str, str]:
    """Versions that must agree between the hosts of one robot."""
    found = {name: importlib.metadata.version(name) for name in ("navloom", "eclipse-zenoh", "numpy")}
    return found | {"python": platform.python_version()}
