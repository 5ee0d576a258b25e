"""A run of a live robot from its config: all its processes, its goal and events, and what it comes to."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Literal

from navloom.config import Loaded
from navloom.engine.build import assemble
from navloom.engine.checks import check_drive, check_task
from navloom.engine.events import schedule
from navloom.engine.lockstep import RunLog
from navloom.engine.run_warnings import RunWarning
from navloom.engine.system import System
from navloom.engine.trace import TraceWriter
from navloom.hosting.network import network_of
from navloom.hosting.robot import LiveRobot
from navloom.live.cells import all_sources
from navloom.live.conductor import BarrierError, Conductor
from navloom.live.mailbox import Inlet, Mailbox
from navloom.live.placing import spread
from navloom.live.switchboard import Switchboard
from navloom.messages import (
    Envelope,
    Feedback,
    GateStatus,
    GoalResult,
    Message,
    OperatorRequest,
    Point2D,
    PoseEstimate,
    Selection,
    StepReport,
)
from navloom.operating.client import Client, ClientError, Refused
from navloom.plugins.observing import Onlookers
from navloom.recording.excerpt import repeating
from navloom.study.episode import Episode
from navloom.study.live_show import LiveShow
from navloom.study.live_warnings import LiveWarnings
from navloom.study.observed import run_info
from navloom.study.recorder import Recorder
from navloom.transport.keyspace import FAULT

__all__ = ["LiveRun", "run_barrier"]

START = 180.0
"""s a robot may take to come up: kernels may have to be compiled."""
ASK_AGAIN = 2.0
"""s between looks at the goal's last words, in case they came while the network was down."""
TELL_AGAIN = 10.0
"""s until a node that raises again is told of again."""
Beside = Callable[[LiveRobot], AbstractContextManager[None]]
HEARD = {"goal": {"result", "feedback"}, "gate": {"status", "selection"}, "localizer": {"pose"}}
"""Ports that are recorded of every robot, by role, also where another process judges the run."""
LOOK = 0.1
"""s between two looks at what came and at the processes: most of what comes does not wake this one."""
TELLING = ("goal", "gate")
"""Roles whose words are told at once."""
QUIET = 1.0
"""s without a goal after which a run that was to end with its goals does."""


def run_barrier(
    loaded: Loaded,
    *,
    trace: IO[bytes] | None = None,
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[float, float], None] | None = None,
    ends: Callable[[], bool] = lambda: False,
    beside: Beside | None = None,
    onlookers: Onlookers | None = None,
) -> Episode:
    """Run a config in its processes under the barrier: the same trace as in lockstep. See `LiveRun` for the rest.

    Raises:
        ConfigError, PluginError: The request was wrong; StartError: the robot did not come up;
        BarrierError: a node did not report a tick.
    """
    system = assemble(loaded)
    check_task(system)
    recorder, run = Recorder(), loaded.config.run
    with LiveRobot(system, network_of(loaded.config, None, False), None, True, say) as robot, ExitStack() as attending:
        robot.wait_complete(START, ends=ends)
        if beside is not None:
            attending.enter_context(beside(robot))

        def check() -> None:
            if ends():
                raise KeyboardInterrupt
            for child in robot.supervisor.poll(restarts=False):
                raise BarrierError(
                    f"process {child.task.name} {child.why} in the run. "
                    f"Its last message: {robot.supervisor.tail(child)}"
                )

        board = Switchboard(robot.bus, robot.keys, lossless=True)
        shown = [] if onlookers is None else onlookers.begin(run_info(loaded, "barrier"))
        conductor = Conductor(
            system, board, schedule(loaded.config, system.goal), [recorder, *shown], TraceWriter(trace), check
        )
        board.connect()
        ticks = math.ceil(round(system.time_limit / run.period, 6)) + 2
        tell = None if progress is None else (lambda tick: progress(tick * run.period, system.time_limit))
        log = conductor.run(ticks, tell)
        return Episode(system, log, recorder, warnings=LiveWarnings(robot.bus, robot.keys).look())


@dataclass(eq=False)
class LiveRun:
    """A live robot and what its supervisor sees of it.

    Args:
        loaded: The config.
        host: Share of it that runs here; None for all.
        insecure: Plain TCP beyond this host was asked for.
        say: Told what happens.
        beside: What attends it from when every node is there to its end: a recorder.
        onlookers: Observers of plugins, told when every node is there; who hands them in tells them the end.
        recording: File that `beside` writes; None for none.

    Attributes:
        judges: The run is judged here, where the platform is: other hosts are spared all that is judged by.
        feedback, status: The goal's and the gate's newest word.
        result: Of the newest goal that has ended.
        log, recorder: As of a run in lockstep, of the newest goal: a robot may be up for weeks.
    """

    loaded: Loaded
    host: str | None
    insecure: bool
    say: Callable[[str], None]
    ending: threading.Event = field(default_factory=threading.Event)
    feedback: Feedback | None = None
    status: GateStatus | None = None
    result: GoalResult | None = None
    log: RunLog = field(default_factory=RunLog)
    recorder: Recorder = field(default_factory=Recorder)
    beside: Beside | None = None
    onlookers: Onlookers | None = None
    recording: Path | None = None

    def __post_init__(self) -> None:
        self.system: System = assemble(self.loaded)
        check_drive(self.system)
        shares = spread(self.loaded.config, all_sources(self.system), self.host)
        self.judges = any(role == "platform" for share in shares.values() for role, _ in share)
        self._mailbox = Mailbox()
        self._inlets: list[tuple[tuple[str, str], str, Inlet]] = []
        self._chosen: dict[str, str] = {}
        self._began_ns = time.perf_counter_ns()
        self._ended: deque[GoalResult] = deque()
        self._place = Point2D(0.0, 0.0)
        self._newest_goal = self._first_tick = self._last_tick = self._own_goal = 0
        self._told_faults: dict[tuple[str, str], float] = {}
        self._warned: list[RunWarning] = []
        self._warnings: LiveWarnings | None = None

    def run(
        self,
        until_idle: bool,
        progress: Callable[[Any], None] = lambda left: None,
        look: Callable[[LiveRobot], None] = lambda robot: None,
        ended: Callable[[Episode], None] | None = None,
    ) -> Episode | None:
        """Bring it up, drive the config's goal and events, and stay until told to end.

        Args:
            until_idle: End when the last goal has ended.
            progress: Told who is missing while it comes up.
            look: Called now and then with the robot.
            ended: Told of each goal that ended.

        Returns:
            What the goals came to; None where there was none.

        Raises:
            StartError: It did not come up; DirectoryError: it is up already.
        """
        network = network_of(self.loaded.config, self.host, self.insecure)
        attended = self.beside is not None and network.keys is None  # behind certificates who looks announces nothing
        with LiveRobot(self.system, network, self.host, False, self.say, attended, self.ending.is_set) as robot:
            robot.wait_complete(START if self.host is None else math.inf, progress, self.ending.is_set)
            if not self.ending.is_set():
                show = self._listen(robot)
                with ExitStack() as stack:
                    if self.beside is not None:
                        stack.enter_context(self.beside(robot))
                    stack.enter_context(closing(show))
                    if self.judges:  # the host of the platform asks all processes
                        self._warnings = stack.enter_context(LiveWarnings(robot.bus, robot.keys, self.say))
                    self.say("up: every node is there")  # and who attends it too: what is asked from now on is recorded
                    self._drive(robot, until_idle, look, ended)
        return self._episode() if self.log.results else None

    def _episode(self) -> Episode:
        # What was shortest is known for the config's own goal alone, which began at the config's start.
        is_own = bool(self.log.results) and self.log.results[-1].goal_id == self._own_goal
        system = self.system if is_own else replace(self.system, goal=None)
        return Episode(system, self.log, self.recorder, warnings=self._warned)

    def _listen(self, robot: LiveRobot) -> LiveShow:
        """Hear how it goes, and what the run is judged by, where it is: that would fill a slow link to another host."""
        board = Switchboard(robot.bus, robot.keys, lossless=False)
        wanted = (self.recorder.wants or frozenset()) if self.judges else frozenset()
        for source in all_sources(self.system):
            ports = {port for role, port in wanted if role == source[0]}
            ports |= HEARD.get(source[0], set())
            if self.judges and source[0] != "operator":
                ports.add(FAULT)
            for port in sorted(ports):
                rings = port in HEARD.get(source[0], ()) and source[0] in TELLING
                self._inlets.append((source, port, board.inlet(source, port, self._mailbox, 1024, rings)))
        shown = [] if self.onlookers is None else self.onlookers.begin(run_info(self.loaded, "live"))
        show = LiveShow(self.system, board, shown if self.judges else (), self._is_active)
        board.connect()
        return show

    def _drive(
        self,
        robot: LiveRobot,
        until_idle: bool,
        look: Callable[[LiveRobot], None],
        tell: Callable[[Episode], None] | None,
    ) -> None:
        client = Client(robot.bus, robot.keys)
        requests = deque(sorted(schedule(self.loaded.config, self.system.goal).items()))
        is_ours = self.host is None
        first: int | None = None
        tick = -1
        seen, idle_since, asked = 0, time.monotonic(), time.monotonic()
        while not self.ending.is_set():
            seen = self._mailbox.wait(seen, self._patience(requests, first, tick))
            tick = max(tick, self._take())
            if first is None and tick >= 0:
                first = tick
            while is_ours and first is not None and requests and tick - first >= requests[0][0]:
                for request in requests.popleft()[1]:
                    self._ask(client, request)
                idle_since = time.monotonic()
            robot.supervisor.poll()
            robot.warn_of_expiry()
            look(robot)
            if self.feedback is not None and self.feedback.goal_id and time.monotonic() - asked > ASK_AGAIN:
                asked = time.monotonic()
                self._catch_up(client)
            if self._ended or (self.feedback is not None and self.feedback.goal_id):
                idle_since = time.monotonic()
            self._tell_ended(client, tell)
            if until_idle and not requests and time.monotonic() - idle_since > QUIET:
                return
        self._take()
        if self.feedback is not None and self.feedback.goal_id:
            self._catch_up(client)  # its result may be on the way
        if is_ours:
            self._give_up(robot.keys.prefix)
        self._tell_ended(client, tell)

    def _patience(self, requests: Sequence[tuple[int, Any]], first: int | None, tick: int) -> float:
        """s until the next look: the tick of a request of the config is not passed over by many."""
        if not requests:
            return LOOK
        period = self.loaded.config.run.period
        left = 0 if first is None else requests[0][0] - (tick - first)
        return min(LOOK, period * max(1, left))

    def _give_up(self, robot: str) -> None:
        """The robot goes down: a goal on its way ends with it."""
        number = 0 if self.feedback is None else self.feedback.goal_id
        if number:
            self._end(GoalResult(number, "error", f"robot {robot} went down, and goal {number} with it", self._place))

    def _tell_ended(self, client: Client, tell: Callable[[Episode], None] | None) -> None:
        while self._ended:
            self.log.results = [self._ended.popleft()]
            self._learn_times(client)
            self._warned = [] if self._warnings is None else self._warnings.look()
            if tell is not None:
                tell(self._episode())

    def _catch_up(self, client: Client) -> None:
        """Take in what came while the network was down."""
        result = client.last("goal", "main", "result", timeout=0.2)
        if isinstance(result, GoalResult):
            self._end(result)
        feedback = client.last("goal", "main", "feedback", timeout=0.2)
        if isinstance(feedback, Feedback):
            self.feedback = feedback

    def _end(self, result: GoalResult) -> None:
        """A goal has ended; the same may be heard twice."""
        if all(one.goal_id != result.goal_id for one in (*self.log.results, *self._ended)):
            self._ended.append(result)
            self.result = result
            self.log.wall_ns = time.perf_counter_ns() - self._began_ns

    def _begin(self, goal_id: int, tick: int) -> None:
        """A goal begins: what the one before left is forgotten, but for the map."""
        self._newest_goal, self._first_tick = goal_id, tick
        self.log = RunLog(results=self.log.results, swaps=self.log.swaps)
        self.recorder = Recorder(map=self.recorder.map)
        self._began_ns = time.perf_counter_ns()

    def _ask(self, client: Client, request: OperatorRequest) -> None:
        """Do what the config's goal or one of its events asks for."""
        try:
            if request.goal is not None:
                goal = request.goal
                via = [[point.x, point.y] for point in goal.via]
                given = {"x": goal.x, "y": goal.y, "heading": goal.heading, "via": via}
                answer = client.call("goal", "main", "submit", given)
                self._own_goal = self._own_goal or int(answer["goal_id"])
            elif request.do == "cancel":
                client.call("goal", "main", "cancel", {})
            elif request.do == "swap":
                client.call("gate", "main", "swap", {"role": request.role, "instance": request.instance})
            elif request.do == "set":
                client.call(request.role, request.instance, "params/set", {"values": list(request.values)})
            else:
                client.call("gate", "main", request.do, {})
        except (Refused, ClientError) as error:
            if request.goal is not None:
                outcome: Literal["rejected", "error"] = "rejected" if isinstance(error, Refused) else "error"
                reason, place = str(error).removeprefix("rejected: "), Point2D(request.goal.x, request.goal.y)
                self._ended.append(GoalResult(0, outcome, reason, place))
            self.say(f"{request.do}: {error}")

    def _take(self) -> int:
        """Take in what came; gives the newest tick of the platform."""
        newest = -1
        for source, port, inlet in self._inlets:
            for message, envelope in inlet.take():
                self._note(source, port, message, envelope)
                if source[0] == "platform":
                    newest = max(newest, envelope.tick)
        self._last_tick = newest if newest >= 0 else self._last_tick
        return newest

    def _note(self, source: tuple[str, str], port: str, message: Message, at: Envelope) -> None:
        role, name = source
        active = self._is_active(role, name)
        if isinstance(message, StepReport):
            if message.fault:
                self._tell_fault(source, message.fault, at.tick)
        elif isinstance(message, PoseEstimate):
            self._place = Point2D(message.pose.x, message.pose.y) if active else self._place
        elif isinstance(message, GoalResult):
            self._end(message)
        elif isinstance(message, Feedback):
            self.feedback = message
            if message.goal_id > self._newest_goal:
                self._begin(message.goal_id, at.tick)
        elif isinstance(message, GateStatus):
            self.status = message
            self.log.hear_gate(message)
        elif isinstance(message, Selection):
            self._chosen = message.chosen
            self.log.swaps = message.epoch
        else:
            self.recorder.on_message(role, name, active, port, message, at)

    def _tell_fault(self, source: tuple[str, str], fault: str, tick: int) -> None:
        """Say what a node raised; one that raises each tick is not told of each time."""
        now = time.monotonic()
        if now - self._told_faults.get(source, -math.inf) > TELL_AGAIN:
            self._told_faults[source] = now
            traceback = "" if self._warnings is None else self._warnings.traceback_of(fault)
            self.say("\n".join([f"{' '.join(source)} failed: {fault}", *traceback.splitlines()]))
            if self.recording is not None:
                is_only = sum(role == source[0] for role, _ in self.system.parts) == 1
                self.say(f"repeat that step: {repeating(self.recording, *source, tick, is_only)}")

    def _is_active(self, role: str, name: str) -> bool:
        return self._chosen.get(role, self._default(role)) == name

    def _default(self, role: str) -> str:
        return "main" if role in ("goal", "gate", "reference") else self.loaded.config.role_table(role).instance

    def _learn_times(self, client: Client) -> None:
        """Ask the active nodes how long their steps took since the goal began; those that are gone are left out."""
        spent: dict[int, int] = defaultdict(int)
        for answer in [] if not self.judges else client.bus.ask(client.keys.process("*", "steps"), timeout=1.0):
            for place, steps in json.loads(answer.data or b"{}").items():
                role, _, name = place.partition(" ")
                if self._chosen.get(role, self._default(role)) != name:
                    continue
                own = [(tick, took_ns) for tick, took_ns in steps if self._first_tick <= tick <= self._last_tick]
                for tick, took_ns in own:
                    spent[tick] += took_ns
                if role in self.log.step_ns:
                    self.log.step_ns[role] = [took_ns for _, took_ns in own]
        self.log.ticks = 1 + max(0, self._last_tick - self._first_tick)
        self.log.tick_ns = [spent[tick] for tick in sorted(spent)] or [0]
