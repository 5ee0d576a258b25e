"""Runs a live robot from its config: its processes, goal and events, and the resulting episode."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from navloom.config import Loaded
from navloom.config.tables import OWN_NODES, WORLD_NODE
from navloom.engine.build import assemble
from navloom.engine.event_schedule import schedule
from navloom.engine.lockstep import RunLog
from navloom.engine.run_warnings import RunWarning
from navloom.engine.shadow_state import ShadowState
from navloom.engine.system import System
from navloom.engine.task_checks import check_live
from navloom.messages import (
    Envelope,
    Feedback,
    GateStatus,
    GoalResult,
    MapUpdate,
    Message,
    OccupancyGrid,
    OperatorRequest,
    Point2D,
    PoseEstimate,
    Selection,
    StepReport,
    Truth,
)
from navloom.plugins.run_observers import Onlookers
from navloom.runs.episode import Episode, run_info
from navloom.runs.episode_recorder import Recorder, streams_of
from navloom_recording.excerpt import repeating

from navloom_live.drives.live_observers import LiveShow
from navloom_live.drives.live_shadows import LiveShadows
from navloom_live.drives.live_warnings import LiveWarnings
from navloom_live.hosting.kept_pose import KeptPose, keeps_pose, resume
from navloom_live.hosting.live_robot import Beside, LiveRobot
from navloom_live.hosting.network import network_of
from navloom_live.live import requests
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.mailbox import Inlet, Mailbox
from navloom_live.live.node_placement import spread
from navloom_live.live.process_streams import Switchboard
from navloom_live.live.service import GATE, Nothing
from navloom_live.operating import operator_actions
from navloom_live.operating.client import Client, ClientError, Refused
from navloom_live.operating.introspection import last
from navloom_live.timing import START_LIMIT
from navloom_live.transport.keyspace import FAULT

__all__ = ["LiveRun"]

LAST_MESSAGES_INTERVAL = 2.0
"""Interval of queries for the goal's last messages, s, in case they came while the network was down."""
FAULT_REPORT_INTERVAL = 10.0
"""Shortest time between two reports of the same failing node, s."""
STARTING = 10.0
"""Run time in which a platform may fail without a report, s: a driver may still join its network, see `status`."""
HEARD = {"goal": {"result", "feedback"}, "gate": {"status", "selection"}, "localizer": {"pose"}}
"""Ports that are subscribed to on every host, by role, also if the run is judged on another host."""
POLL_INTERVAL = 0.1
"""Polling interval for messages and processes, s: most messages do not wake this thread."""
TELLING = ("goal", "gate")
"""Roles whose messages wake this thread immediately."""
KEPT_AFTER_NS = 10_000_000_000
"""Run time after the end of a goal in which its data is still kept, ns; then only maps are, until the next goal."""
NO_GOAL_LIMIT = 1.0
"""Time without a goal after which a run that ends with its goals ends, s."""


@dataclass(eq=False)
class LiveRun:
    """A live robot as its supervisor observes it.

    Args:
        loaded: The config.
        host: Share of it that runs here; None for all.
        insecure: Plain TCP to other hosts was requested.
        say: Receives messages about events.
        beside: Runs beside the robot from the time when every node is up to the end: a recorder.
        onlookers: Observers of plugins. They are notified when every node is up; the caller notifies them of the end.
        recording: File that `beside` writes; None for none.
        reads: Streams that metrics read, `(role or node, port)`: the recorder keeps their messages.
        keeps: Keep the robot's pose, if its config allows that. resumes: Begin at the pose that was kept.

    Attributes:
        judges: Whether the run is judged here, on the host of the platform; other hosts do not receive the data for it.
        feedback, status: Newest feedback of the goal and status of the gate.
        result: Result of the newest goal that has ended.
        log, recorder: Data of the newest goal only, as in lockstep, and none from `KEPT_AFTER_NS` after its end to the
            next one: a robot may be up for weeks, and stand for most of them.
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
    recorder: Recorder = field(init=False)
    beside: Beside | None = None
    onlookers: Onlookers | None = None
    recording: Path | None = None
    reads: frozenset[tuple[str, str]] = frozenset()
    keeps: bool = False
    resumes: bool = False

    def __post_init__(self) -> None:
        self.reads = streams_of(self.reads, self.loaded.config)
        self.recorder = Recorder(reads=self.reads)
        self.system: System = assemble(self.loaded)
        self._kept: KeptPose | None = None
        if self.keeps and self.host is None and keeps_pose(self.system):
            self._kept, loaded = resume(self.system, self.resumes, self.say)
            if loaded is not self.loaded:
                self.loaded, self.system = loaded, assemble(loaded)
        check_live(self.system)
        shares = spread(self.loaded.config, all_sources(self.system), self.host)
        self.judges = any(role == "platform" for share in shares.values() for role, _ in share)
        self._mailbox = Mailbox()
        self._inlets: list[tuple[tuple[str, str], str, Inlet]] = []
        self._chosen: dict[str, str] = {}
        self._epoch = 0
        self._shadows: LiveShadows | None = None
        self._began_ns = time.perf_counter_ns()
        self._ended: deque[GoalResult] = deque()
        self._place = Point2D(0.0, 0.0)
        self._newest_goal = self._first_tick = self._last_tick = self._own_goal = 0
        self._keeps_until_ns: float = 0.0
        self._stamp_ns = 0
        self._told_faults: dict[tuple[str, str], float] = {}
        self._warned: list[RunWarning] = []
        self._warnings: LiveWarnings | None = None

    def run(
        self,
        until_idle: bool,
        progress: Callable[[Any, int, Any], None] = lambda left, total, kernels: None,
        look: Callable[[LiveRobot], None] = lambda robot: None,
        ended: Callable[[Episode], None] | None = None,
    ) -> Episode | None:
        """Start the robot, drive the config's goal and events, and run until it is stopped.

        Args:
            until_idle: End when the last goal has ended.
            progress: Called during startup; see `LiveRobot.wait_complete`.
            look: Called at intervals with the robot.
            ended: Called with the episode of each ended goal.

        Returns:
            The episode of the last goal; None if there was no goal.

        Raises:
            StartError: The robot did not start; DirectoryError: it is up already.
        """
        network = network_of(self.loaded.config, self.host, self.insecure)
        attended = self.beside is not None and network.keys is None  # with certificates, observers announce nothing
        with LiveRobot(self.system, network, self.host, False, self.say, attended, self.ending.is_set) as robot:
            robot.wait_complete(START_LIMIT if self.host is None else math.inf, progress, self.ending.is_set)
            if not self.ending.is_set():
                show = self._listen(robot)
                with ExitStack() as stack:
                    if self.beside is not None:
                        stack.enter_context(self.beside(robot))
                    stack.enter_context(closing(show))
                    if self.judges:  # the host of the platform queries all processes
                        self._warnings = stack.enter_context(LiveWarnings(robot.bus, robot.keys, self.say))
                    self.say("up: every node is there")  # and so is the recorder: all requests from now on are recorded
                    self._drive(robot, until_idle, look, ended)
        if self._kept is not None:
            self._kept.write()
        return self._episode() if self.log.results else None

    def _episode(self) -> Episode:
        # The shortest path is known only for the config's own goal, which starts at the config's start pose.
        is_own = bool(self.log.results) and self.log.results[-1].goal_id == self._own_goal
        system = self.system if is_own else replace(self.system, goal=None)
        shadows = [] if self._shadows is None else self._shadows.finish()
        return Episode(system, self.log, self.recorder, shadows, self._warned)

    def _listen(self, robot: LiveRobot) -> LiveShow:
        """Subscribe to the status, and to the data for judging only on the judging host: it would fill a slow link."""
        self._board = board = Switchboard(robot.bus, robot.keys, lossless=False)
        for source in all_sources(self.system):
            self._subscribe(source)
        if self.judges:
            self._shadows = LiveShadows(self.system, board, self._is_active, self.say)
        shown = [] if self.onlookers is None else self.onlookers.begin(run_info(self.loaded, "live"))
        show = LiveShow(self.system, board, shown if self.judges else (), self._is_active)
        board.connect()
        return show

    def _subscribe(self, source: tuple[str, str]) -> None:
        wanted = (self.recorder.wants or frozenset()) if self.judges else frozenset()
        ports = {port for role, port in wanted if role == source[0]}
        ports |= HEARD.get(source[0], set())
        if self.judges and source[0] != "operator":
            ports.add(FAULT)
        for port in sorted(ports):
            rings = port in HEARD.get(source[0], ()) and source[0] in TELLING
            self._inlets.append((source, port, self._board.inlet(source, port, self._mailbox, 1024, rings)))

    def _follow(self, system: System) -> None:
        """Take in instances that the robot has gained."""
        known, self.system, self.loaded = set(all_sources(self.system)), system, system.loaded
        for source in all_sources(system):
            if source not in known:
                self._subscribe(source)
        if self._shadows is not None:
            self._shadows.extend(system)
        self._board.connect()

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
            if robot.system is not self.system:
                self._follow(robot.system)
            robot.warn_of_expiry()
            look(robot)
            if (
                self.feedback is not None
                and self.feedback.goal_id
                and time.monotonic() - asked > LAST_MESSAGES_INTERVAL
            ):
                asked = time.monotonic()
                self._catch_up(client)
            if self._ended or (self.feedback is not None and self.feedback.goal_id):
                idle_since = time.monotonic()
            self._tell_ended(client, tell)
            if until_idle and not requests and self._has_come_to_rest(time.monotonic() - idle_since):
                return
        self._take()
        if self.feedback is not None and self.feedback.goal_id:
            self._catch_up(client)  # its result may be on the way
        if is_ours:
            self._give_up(robot.keys.prefix)
        self._tell_ended(client, tell)

    def _has_come_to_rest(self, idle: float) -> bool:
        """Whether a robot without a goal for this long, s, may end: it no longer brakes, or never comes to rest."""
        brakes = self.status is not None and self.status.source == "none" and not self.status.stopped
        return idle > (NO_GOAL_LIMIT + self.system.braking.patience if brakes else NO_GOAL_LIMIT)

    def _patience(self, requests: Sequence[tuple[int, Any]], first: int | None, tick: int) -> float:
        """Time until the next poll, s: short enough not to miss the tick of the config's next request by many."""
        if not requests:
            return POLL_INTERVAL
        period = self.loaded.config.run.period
        left = 0 if first is None else requests[0][0] - (tick - first)
        return min(POLL_INTERVAL, period * max(1, left))

    def _give_up(self, robot: str) -> None:
        """End a goal in progress, because the robot shuts down."""
        number = 0 if self.feedback is None else self.feedback.goal_id
        if number:
            why = f"robot {robot} went down, and goal {number} with it"
            self._end(GoalResult(number, "error", why, self._place, "robot_down"))

    def _tell_ended(self, client: Client, tell: Callable[[Episode], None] | None) -> None:
        while self._ended:
            self.log.results = [self._ended.popleft()]
            if self.log.results[0].goal_id == self._newest_goal and math.isinf(self._keeps_until_ns):
                self._keeps_until_ns = self._stamp_ns + KEPT_AFTER_NS
            self._learn_times(client)
            self._warned = [] if self._warnings is None else self._warnings.look()
            if tell is not None:
                tell(self._episode())

    def _catch_up(self, client: Client) -> None:
        """Fetch messages that came while the network was down."""
        result = last(client, "goal", "main", "result", timeout=0.2)
        if isinstance(result, GoalResult):
            self._end(result)
        feedback = last(client, "goal", "main", "feedback", timeout=0.2)
        if isinstance(feedback, Feedback):
            self.feedback = feedback

    def _end(self, result: GoalResult) -> None:
        """Store the result of an ended goal; it may be received twice."""
        if all(one.goal_id != result.goal_id for one in (*self.log.results, *self._ended)):
            self._ended.append(result)
            self.result = result
            self.log.wall_ns = time.perf_counter_ns() - self._began_ns

    def _begin(self, goal_id: int, tick: int) -> None:
        """Begin a goal: drop the data of the previous one, except the map."""
        self._newest_goal, self._first_tick, self._keeps_until_ns = goal_id, tick, math.inf
        self.log = RunLog(results=self.log.results, swaps=self.log.swaps)
        old = self.recorder
        self.recorder = Recorder(map=old.map, known=old.known, began=old.began, missed=old.missed, reads=self.reads)
        self._began_ns = time.perf_counter_ns()
        if self._shadows is not None:
            self._shadows.begin()

    def _ask(self, client: Client, request: OperatorRequest) -> None:
        """Send the request of the config's goal or of one of its events."""
        try:
            if request.do == "goal" and request.goal is not None:
                goal = request.goal
                via = tuple((point.x, point.y) for point in goal.via)
                answer = client.call(
                    "goal", "main", requests.SUBMIT, requests.Submit(goal.x, goal.y, goal.heading, via)
                )
                self._own_goal = self._own_goal or answer.goal_id
            elif request.do == "cancel":
                client.call("goal", "main", requests.CANCEL, Nothing())
            elif request.do == "swap":
                client.call("gate", "main", requests.SWAP, requests.Swap(request.role, request.instance))
            elif request.do == "set":
                values = requests.Assignments(tuple(request.values))
                client.call(request.role, request.instance, requests.SET_PARAMETERS, values)
            elif request.do == "place" and request.goal is not None:
                guess = request.spread is not None and request.heading_spread is not None
                sigma = (request.spread, request.heading_spread) if guess else None
                pose = request.goal.x, request.goal.y, request.goal.heading or 0.0
                operator_actions.place(client, *pose, sigma)  # type: ignore[arg-type]
            elif request.do == "relocalise":
                operator_actions.relocalise(client)
            else:
                client.call("gate", "main", GATE[request.do], Nothing())
            if request.do != "goal":  # a goal is printed with its number
                self.say(" ".join(filter(None, ("[[event]]:", request.do, request.role, request.instance))))
        except (Refused, ClientError) as error:
            if request.do == "goal" and request.goal is not None:
                outcome: Literal["rejected", "error"] = "rejected" if isinstance(error, Refused) else "error"
                reason, place = str(error).removeprefix("rejected: "), Point2D(request.goal.x, request.goal.y)
                self._ended.append(GoalResult(0, outcome, reason, place, "refused" if outcome == "rejected" else ""))
            self.say(f"{request.do}: {error}")

    def _take(self) -> int:
        """Process new messages; returns the newest tick of the platform."""
        newest = -1
        for source, port, inlet in self._inlets:
            for message, envelope in inlet.take():
                self._note(source, port, message, envelope)
                if source[0] == "platform":
                    newest = max(newest, envelope.tick)
        self._last_tick = newest if newest >= 0 else self._last_tick
        if self._shadows is not None:
            self._shadows.look()
        return newest

    def _note(self, source: tuple[str, str], port: str, message: Message, at: Envelope) -> None:
        role, name = source
        active = self._is_active(role, name)
        if isinstance(message, StepReport):
            if message.fault:
                self._tell_fault(source, message.fault, at.tick)
        elif isinstance(message, PoseEstimate):
            self._place = Point2D(message.pose.x, message.pose.y) if active else self._place
            if active and self._kept is not None:
                self._kept.note(message)
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
            for of, instance in message.chosen.items() if message.epoch > self._epoch else ():
                before = self._chosen.get(of, self._default(of))
                if instance != before:
                    self.say(f"{of}: {instance} is active instead of {before} (selection {message.epoch})")
            self._chosen, self._epoch = message.chosen, message.epoch
            self.log.swaps = message.epoch
        # After a feedback, which begins a new goal.
        is_first = isinstance(message, Truth) and math.isnan(self.recorder.began)
        if at.stamp_ns <= self._keeps_until_ns or is_first or isinstance(message, (MapUpdate, OccupancyGrid)):
            self.recorder.on_message(role, name, active, port, message, at)
        self._stamp_ns = max(self._stamp_ns, at.stamp_ns)

    def _tell_fault(self, source: tuple[str, str], fault: str, tick: int) -> None:
        """Report a node's exception; one that raises in each tick is not reported each time."""
        if source[0] == "platform" and tick * self.system.config.run.period < STARTING:
            return
        now = time.monotonic()
        if now - self._told_faults.get(source, -math.inf) > FAULT_REPORT_INTERVAL:
            self._told_faults[source] = now
            traceback = "" if self._warnings is None else self._warnings.traceback_of(fault)
            self.say("\n".join([f"{' '.join(source)} failed: {fault}", *traceback.splitlines()]))
            if self.recording is not None:
                is_only = sum(role == source[0] for role, _ in self.system.parts) == 1
                self.say(f"repeat that step: {repeating(self.recording, *source, tick, is_only)}")

    @property
    def shadows(self) -> list[ShadowState]:
        """Comparison of each shadow in the newest drive, see `Disagreement.so_far`."""
        return [] if self._shadows is None else self._shadows.so_far()

    def _is_active(self, role: str, name: str) -> bool:
        return self._chosen.get(role, self._default(role)) == name

    def _default(self, role: str) -> str:
        return "main" if role in (*OWN_NODES, WORLD_NODE) else self.loaded.config.role_table(role).instance

    def _learn_times(self, client: Client) -> None:
        """Query the durations of the active nodes' steps since the goal began; nodes that are gone are left out."""
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
