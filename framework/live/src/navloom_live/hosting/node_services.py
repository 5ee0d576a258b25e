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
from functools import cache, partial

from navloom.config import Loaded
from navloom.engine.answer_checks import notes_of
from navloom.engine.lockstep_builder import goal_rules
from navloom.engine.nodes.localizer_node import LocalizerNode
from navloom.engine.nodes.mapper_node import MapperNode
from navloom.engine.nodes.planner_node import PlannerNode
from navloom.engine.parameter_changes import changed_params
from navloom.engine.plugin_factory import configure
from navloom.engine.system import System
from navloom.engine.task_checks import place_problem
from navloom.entry_kinds import TRACEBACK
from navloom.inputs.texts import refuse_deep_toml
from navloom.messages import Goal, OperatorRequest, Parameters, Path, PlanFailure, PlanRequest, Point2D, Pose2D
from navloom.plugins.error_origin import kept_tracebacks
from navloom.plugins.registry import nearest
from navloom.runs.provenance import distributions

from navloom_live.hosting.node_measures import shared_memory_mb, usual_step, with_punctuality
from navloom_live.hosting.process_warnings import ProcessWarnings
from navloom_live.live import requests
from navloom_live.live.description import Description, ProcessConfig, clocks
from navloom_live.live.live_gate import LiveGate
from navloom_live.live.live_goal import LiveGoal
from navloom_live.live.live_node import Source
from navloom_live.live.live_node_builder import Hosted, all_sources
from navloom_live.live.live_runner import LiveRunner
from navloom_live.live.node_placement import spread
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.replicated_state import Memory
from navloom_live.live.run_clock import RunClock
from navloom_live.live.service import GATE, STOP, Answered, Asked, Nothing, Service, reply
from navloom_live.timing import APPLY_WAIT
from navloom_live.transport.idempotent_requests import Once
from navloom_live.transport.keyspace import KeySpace
from navloom_live.transport.query_limits import Desk, KeptJson, QuestionError
from navloom_live.transport.zenoh_bus import Bus

__all__ = ["ServiceError", "Services"]


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

    def offer(self, extend: Callable[[requests.Extend], requests.Extended] | None = None) -> None:
        """Declare all services of this process; `extend` tells its nodes of an instance that the robot gains."""
        for source in self._hosted:
            self._offer_description(source)
            if source in self._system.parts:
                self._serve(source, requests.GET_PARAMETERS, partial(self._get, source))
        for source, runner in self._live.items():
            if source in self._system.parts:
                self._serve(source, requests.SET_PARAMETERS, partial(self._set, source))
            if source[0] == "localizer":
                self._serve(source, requests.PLACE, partial(self._place, runner))
                self._serve(source, requests.RELOCALISE, partial(self._relocalise, runner))
            if source[0] == "mapper":
                self._serve(source, requests.CLEAR, partial(self._clear, runner))
            if source[0] == "planner":
                self._serve(source, requests.PLAN, partial(self._plan, runner))
            if isinstance(runner, LiveGoal):
                self._serve(source, requests.SUBMIT, partial(self._submit, runner))
                self._serve(source, requests.CANCEL, partial(self._cancel, runner))
                self._serve(source, requests.REPLAN, partial(self._replan, runner))
            if isinstance(runner, LiveGate):
                self._serve(source, requests.SWAP, partial(self._swap, runner))
                self._serve(source, requests.LIMIT, partial(self._limit, runner))
                for service in GATE.values():
                    self._serve(source, service, partial(self._gate, runner, service.name))
        if self._live:
            recalled = KeptJson(lambda: vars(self._memory), lambda: {"clock_ns": self._clock.now_ns()})
            self._show(self._keys.process(self._process, "memory"), "memory", recalled.to_bytes)
            self._show(self._keys.process(self._process, "steps"), "steps", self._step_times)
        if extend is not None:
            self._serve(("process", self._process), requests.EXTEND, extend)
        self._show(self._keys.process(self._process, "config"), "config", self._config)
        self._show(self._keys.process(self._process, "warnings"), "warnings", self._listed_warnings)
        if os.environ.get(TRACEBACK):
            self._show(self._keys.process(self._process, "tracebacks"), "tracebacks", _tracebacks)

    def _serve(self, source: Source, service: Service[Asked, Answered], handler: Callable[[Asked], Answered]) -> None:
        """Serve the requests to a node."""
        key = self._keys.port(*source, service.name)
        self._bus.serve(key, self._desk.window(service.name, reply(key, service, handler, self._once)))

    def _show(self, key: str, service: str, made: Callable[[], bytes]) -> None:
        """Serve queries that carry no data."""
        self._bus.serve(key, self._desk.window(service, lambda question: question.answer(key, made(), "json")))

    def _config(self) -> bytes:
        """The whole config, for recordings: only the running process knows what it runs."""
        loaded = self._system.loaded
        # Kept, as every recorder and tool asks for it; it changes only when an instance is added.
        if self._kept_config[0] is not loaded:
            given = ProcessConfig(
                loaded=loaded.to_json(), barrier=self._board.lossless, distributions=distributions(loaded.config)
            )
            self._kept_config = loaded, given.to_bytes()
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
        described = KeptJson(
            lambda: self._describe(source).to_json(), lambda: clocks(self._clock.now_ns(), time.time_ns())
        )
        self._show(self._keys.port(*source, "describe"), "describe", described.to_bytes)

    def _describe(self, source: Source) -> Description:
        cell = self._hosted[source].cell
        part = self._system.parts.get(source)
        inlets = {feed.inlet.key.removeprefix(f"{self._keys.prefix}/"): feed.inlet for feed in cell.feeds}
        runner, now = self._live.get(source), time.monotonic()
        since_ns = cell.stepper.busy_since_ns
        told = Description(
            role=source[0],
            instance=source[1],
            plugin=part.table.plugin if part is not None else None,
            process=self._process,
            pid=os.getpid(),
            host=platform.node(),
            active=cell.stepper.active,
            enabled=cell.stepper.enabled,
            tick=cell.stepper.stepped,
            epoch=cell.epoch,
            versions=_versions(),
            config_sha256=self._system.loaded.sha256(),
            silence_s=self._clock.silence_s() if self._clock.is_known else None,
            up_s=now - self._began,
            period_s=self._system.config.run.period * cell.stepper.stride,
            step_s=usual_step(runner),
            busy_s=None if since_ns is None else max(0.0, now - since_ns * 1e-9),
            faulted=runner.faulted if runner is not None else 0,
            fault=runner.fault if runner is not None else "",
            notes=tuple(f"{' '.join(source)} {note}" for note in notes_of(cell.node)),
            shares_memory=self._system.config.live.shared_memory,
            waits_for=tuple(cell.stepper.lacks),
            is_patient=self._system.catalogue.is_patient(source[0]),
            shared_memory_mb=shared_memory_mb(),
            published={port: outlet.sequence for port, outlet in cell.outlets.items()},
            carries={port: outlet.carries for port, outlet in cell.outlets.items()},
            streams={stream: inlet.counts.summary(inlet.keeps_latest) for stream, inlet in inlets.items()},
            places=self._places(),
            hosts={process: host for host, share in self._system.config.live.hosts.items() for process in share},
        )
        return with_punctuality(told, runner)

    def _places(self) -> dict[str, str]:
        """Process of each node, by "role instance"."""
        shares = spread(self._system.config, all_sources(self._system), None)
        return {" ".join(source): process for process, share in shares.items() for source in share}

    def _get(self, source: Source, asked: Nothing) -> requests.ParameterValues:
        plugin, version = self._system.plugin(*source), self._hosted[source].cell.versions
        return requests.ParameterValues(version, plugin.params.model_dump(mode="json"))

    # --- what they do -----------------------------------------------------------------------------------------------

    def _set(self, source: Source, asked: requests.Assignments) -> requests.ParameterValues:
        """Check all values, then let the node take them between two steps."""
        values = asked.values
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
        return self._get(source, Nothing())

    def _submit(self, runner: LiveGoal, asked: requests.Submit) -> requests.GoalNumber:
        _refuse_wrong(x=asked.x, y=asked.y, heading=asked.heading or 0.0)
        x, y = asked.x, asked.y
        heading = None if asked.heading is None else math.remainder(asked.heading, math.tau)
        via = tuple(Point2D(*point) for point in asked.via)
        limit = time.monotonic() + APPLY_WAIT
        # A client may be faster than the first message of a platform that has just started.
        while not self._clock.is_known and time.monotonic() < limit:
            time.sleep(0.02)
        if not self._clock.is_known:
            raise ServiceError("rejected: the platform has not been heard yet")
        problem = place_problem(self._system, x, y, heading)
        if problem is not None:
            raise ServiceError(f"rejected: {problem.text}")
        # Two clients may submit at once, and numbers of goals must differ.
        with self._goals:
            number = self._memory.last_goal + 1
            self._memory.last_goal = number
        goal = Goal(number, x, y, heading, via)
        self._apply(
            runner, lambda: runner.submit(OperatorRequest("goal", goal)), patience=max(0.0, limit - time.monotonic())
        )
        return requests.GoalNumber(number)

    def _place(self, runner: LiveRunner, asked: requests.Place) -> requests.Placed:
        """Set a localizer's pose, or have it search near one that is a guess."""
        node = runner.cell.node
        assert isinstance(node, LocalizerNode)
        _refuse_wrong(x=asked.x, y=asked.y, heading=asked.heading)
        for name, sigma in (("spread", asked.spread), ("heading_spread", asked.heading_spread)):
            if sigma is not None and not 0.0 < sigma < math.inf:
                raise ServiceError(f"rejected: {name} is {sigma!r}, expected a number above 0")
        if (asked.spread is None) != (asked.heading_spread is None):
            raise ServiceError("rejected: a guess needs both spread and heading_spread")
        problem = place_problem(self._system, asked.x, asked.y, asked.heading)
        if problem is not None and problem.is_outside:
            raise ServiceError(problem.text)
        goal = Goal(0, asked.x, asked.y, math.remainder(asked.heading, math.tau), ())
        request = OperatorRequest("place", goal, spread=asked.spread, heading_spread=asked.heading_spread)
        self._apply(runner, lambda: node.obey(request))
        # Where a guess is exactly does not matter.
        return requests.Placed(True, "" if problem is None or asked.spread is not None else problem.text)

    def _relocalise(self, runner: LiveRunner, asked: Nothing) -> Nothing:
        """Have a localizer search anywhere."""
        node = runner.cell.node
        assert isinstance(node, LocalizerNode)
        self._apply(runner, lambda: node.obey(OperatorRequest("relocalise")))
        return asked

    def _clear(self, runner: LiveRunner, asked: Nothing) -> Nothing:
        """Clear the map with the next data."""
        node = runner.cell.node
        assert isinstance(node, MapperNode)
        self._apply(runner, node.clear_soon)
        return Nothing()

    def _plan(self, runner: LiveRunner, asked: requests.Between) -> requests.Planned:
        """A path on the newest map, which no node follows."""
        node = runner.cell.node
        found: list[Path | PlanFailure | None] = []
        assert isinstance(node, PlannerNode)
        for place in (asked.start, asked.goal):
            _refuse_wrong(x=place[0], y=place[1], heading=place[2])
        start, goal = (Pose2D(x, y, math.remainder(heading, math.tau)) for x, y, heading in (asked.start, asked.goal))
        request = PlanRequest(0, start, goal)
        self._apply(runner, lambda: found.append(node.answer(request)), waits=True)
        (answer,) = found
        if answer is None:
            raise ServiceError(f"planner {runner.cell.source[1]} has no map yet")
        if isinstance(answer, PlanFailure):
            return requests.Planned((), answer.kind, answer.detail)
        return requests.Planned(tuple((x, y) for x, y in answer.points.tolist()))

    def _replan(self, runner: LiveGoal, asked: Nothing) -> requests.GoalNumber:
        """Plan again from where the localizer now says that the robot is."""
        self._apply(runner, lambda: runner.submit(OperatorRequest("place")))
        return requests.GoalNumber(runner.goal.machine.goal_id)

    def _cancel(self, runner: LiveGoal, asked: Nothing) -> requests.GoalNumber:
        number = runner.goal.machine.goal_id
        self._apply(runner, lambda: runner.submit(OperatorRequest("cancel")))
        return requests.GoalNumber(number)

    def _swap(self, runner: LiveGate, asked: requests.Swap) -> requests.Selected:
        role, name = asked.role, asked.instance
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
        return requests.Selected(tuple(runner.gate.pending), runner.gate.selected[role], runner.gate.epoch)

    def _limit(self, runner: LiveGate, asked: requests.SpeedLimit) -> requests.SpeedLimit:
        """Limit the speed of all sources but the operator."""
        if not (math.isfinite(asked.speed) and asked.speed >= 0.0):
            raise ServiceError(f"rejected: speed limit is {asked.speed!r}, expected 0 for none, or more")
        speed = asked.speed
        if asked.is_percentage:
            speed = 0.0 if speed >= 100.0 else 0.01 * speed * goal_rules(self._system).cruise
        self._apply(runner, lambda: setattr(runner.gate.gate, "speed_limit", speed))
        return requests.SpeedLimit(speed)

    def _gate(self, runner: LiveGate, do: str, asked: Nothing) -> Nothing:
        # A stop is never withdrawn, however long the gate's step takes.
        self._apply(runner, lambda: runner.obey(OperatorRequest(do)), waits=do == STOP.name)  # type: ignore[arg-type]
        return asked

    def _apply(
        self, runner: LiveRunner, change: Callable[[], None], waits: bool = False, patience: float = APPLY_WAIT
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
            # Whoever gets the lock decides: the node begins the change, or the client has given up.
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


def _refuse_wrong(**numbers: float) -> None:
    """Refuse a place in the map, m, with a heading, rad, that no one can mean."""
    for name, value in numbers.items():
        if not math.isfinite(value):
            raise ServiceError(f"rejected: {name} is {value!r}, expected a finite number")
    turn = numbers["heading"]
    if abs(turn) > math.tau + 1e-9:
        raise ServiceError(
            f"rejected: heading is {turn:g} rad, more than a turn; if it is in degrees, give {math.radians(turn):.4g}"
        )


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
