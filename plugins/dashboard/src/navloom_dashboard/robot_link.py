"""The dashboard's connection to one robot: reads its streams and sends what operators do. It joins again by itself."""

from __future__ import annotations

import asyncio
import contextlib
import zlib
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from navloom import ROLES, MapUpdate, NavloomError
from navloom.plugins import Discovery
from navloom_live import ClientError, DirectoryError, Driver, Navigator, Told

from navloom_dashboard import frames
from navloom_dashboard.outbox import Frame, Outbox, text_frame
from navloom_dashboard.robot_view import AgeClock, RobotView

__all__ = ["RobotLink", "Where"]

T = TypeVar("T")
TAKE_WAIT = 0.1
"""Longest wait for messages, s, and so the longest delay before the reader ends."""
LOOK_INTERVAL = 1.0
"""Interval of looking which nodes and streams the robot has, s."""
MAP_INTERVAL = 1.0
"""Shortest time between two maps, s."""
JOIN_AGAIN = 1.0
"""Time before the next attempt to join a robot that is gone, s."""
GONE_AFTER = 3
"""Number of looks in a row that find no node, after which the robot is gone."""
QUEUE = 16
"""Most messages of a stream that wait for the reader."""
UNREAD = ("step", "fault", "known", "rollouts", "truth", "bodies", "handover", "drive", "plan", "clear",
          "request", "reference")  # fmt: skip
"""Ports that the page does not show."""


@dataclass(frozen=True)
class Where:
    """How to reach a robot; arguments of `navloom.Navigator`."""

    robot: str | None = None
    connect: str | None = None
    keys: str | None = None
    insecure: bool = False

    def navigator(self) -> Navigator:
        """A navigator with the certificate that may do most."""
        return Navigator(self.robot, self.connect, self.keys, self.insecure, "operator or viewer")


class RobotLink:
    """One robot.

    Args:
        name: REALM/NAME.
        where: How to reach it.
        loop: The server's loop.

    Attributes:
        latest: Newest frame of each slot, for pages that are opened later.
        may_operate: Whether the certificate allows to act.
        world: The map or world that its poses are in, with its realm.
    """

    def __init__(self, name: str, where: Where, loop: asyncio.AbstractEventLoop) -> None:
        self.name, self.where, self._loop = name, where, loop
        self.latest: dict[str, Frame] = {}
        self.may_operate = False
        self._outboxes: set[Outbox] = set()
        self._clock = AgeClock()
        self._reads, self._acts, self._encodes, self._stops = (
            ThreadPoolExecutor(count, f"{name} {what}")
            for what, count in (("reads", 2), ("acts", 4), ("encodes", 1), ("stops", 1))
        )
        self._ends = False
        self._acting: Navigator | None = None
        self._reader: Navigator | None = None
        self._view = RobotView({}, 0.0)
        self._encoding: Future[None] | None = None
        self._map: tuple[int, int] = (0, 0)
        self._mapped = -MAP_INTERVAL
        self._next_map: MapUpdate | None = None
        self._shown_map: MapUpdate | None = None
        self._maps: dict[str, MapUpdate] = {}
        self._stopping = asyncio.Lock()
        self._next_stop: asyncio.Task[None] | None = None
        self._fixed: dict[str, Any] = {}
        self.world = ""

    # --- reading ----------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Read until `close`; join again while the robot is gone."""
        why = ""
        while not self._ends:
            try:
                await self._on(self._reads, self._read)
                why = "it has gone"
            except NavloomError as error:
                why = str(error)
            except RuntimeError:  # the executor is shut down
                break
            self._acting, self._reader, self._fixed = None, None, {}
            self._put([text_frame("gone", {"why": why}, None)])
            await asyncio.sleep(JOIN_AGAIN)

    def close(self) -> None:
        """End the threads."""
        self._ends = True
        for pool in (self._reads, self._acts, self._encodes, self._stops):
            pool.shutdown(wait=False, cancel_futures=True)

    def _read(self) -> None:
        """Read while the robot is there."""
        with self.where.navigator() as acting, self.where.navigator() as robot:
            self.may_operate = robot.client.may_operate
            nodes = robot.client.describe()
            about = self._about(robot, nodes)
            active = {node.role: node.instance for node in nodes if node.active}
            self._view = RobotView(active, self._fixed["height"])
            self._maps, self._shown_map = {}, None
            self._send([about])
            listening = robot.listen(_shown(robot.streams()), QUEUE)
            self._acting, self._reader = acting, robot
            looked, absent, looking = self._loop.time(), 0, None
            while not self._ends and absent < GONE_AFTER:
                told = listening.take(TAKE_WAIT)
                self._take(told)
                if looking is not None and looking.done():
                    nodes, streams = looking.result()
                    looking, looked = None, self._loop.time()
                    absent = 0 if nodes else absent + 1
                    if nodes:
                        listening.add(_shown(streams))
                        self._view.loads = [_load(node) for node in nodes]
                        self._send([self._about(robot, nodes)])
                elif looking is None and self._loop.time() - looked > LOOK_INTERVAL:
                    looking = self._reads.submit(lambda: (robot.client.describe(), robot.streams()))

    def _take(self, told: list[Told]) -> None:
        now = self._loop.time()
        for one in told:
            if one.role in ("platform", "localizer"):
                self._clock.hear(one.stamp_ns, now)
        found = list(self._view.take(told))
        self._maps |= {one.instance: one.message for one in told if isinstance(one.message, MapUpdate)}
        active = self._maps.get(self._view.active.get("mapper", next(reversed(self._maps), "")))
        if active is not self._shown_map:  # a new one, or that of another mapper, which may not change for long
            self._shown_map = self._next_map = active
        is_free = self._encoding is None or self._encoding.done()
        if self._next_map is not None and is_free and now - self._mapped > MAP_INTERVAL:
            self._mapped, update, self._next_map = now, self._next_map, None
            self._encoding = self._encodes.submit(self._encode, update)
        if found:
            self._send(found)

    def _encode(self, update: MapUpdate) -> None:
        """Send a map that has changed; on a thread of its own, because a large one takes a while."""
        sum_of = zlib.crc32(update.grid.cells.tobytes())
        if sum_of != self._map[0] or "map" not in self.latest:  # a robot that was gone may have the same map again
            self._map = sum_of, self._map[1] + 1
            self._send([frames.map_frame(update, self._map[1])])

    def _about(self, robot: Navigator, nodes: list[Any]) -> Frame:
        """The frame of what the robot is."""
        if not self._fixed:
            self._fixed, self.world = _fixed(robot)
        roles: dict[str, list[dict[str, Any]]] = {}
        for node in nodes:
            if node.plugin:
                roles.setdefault(node.role, []).append({
                    "instance": node.instance, "plugin": node.plugin, "active": node.active, "enabled": node.enabled,
                    "fault": node.fault if node.faulted else "",
                })  # fmt: skip
        right = "operate" if self.may_operate else "view"
        return text_frame("robot", {"name": self.name, "right": right, "roles": roles, **self._fixed}, None)

    def _send(self, found: list[Frame]) -> None:
        """Hand frames to the loop, from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._put, found)

    def _put(self, found: list[Frame]) -> None:
        for frame in found:
            if frame.slot == "gone":
                self.latest.clear()
            else:
                self.latest.pop("gone", None)
            self.latest[frame.slot] = frame
            for outbox in self._outboxes:
                outbox.put(frame)

    @contextmanager
    def outbox(self) -> Iterator[Outbox]:
        """Frames for one page, the newest of each slot first."""
        outbox = Outbox()
        for frame in self.latest.values():
            outbox.put(frame)
        self._outboxes.add(outbox)
        try:
            yield outbox
        finally:
            self._outboxes.discard(outbox)

    def show(self, frame: Frame) -> None:
        """Send a frame that was not made of the robot's own messages, if it has changed and the robot is there."""
        if self._reader is not None and self.latest.get(frame.slot) != frame:
            self._put([frame])

    @property
    def pose(self) -> dict[str, Any] | None:
        """Its name, footprint, pose and the age of that, for the pages of other robots; None while it is gone or does
        not know it."""
        estimate = self._view.pose if self._reader is not None else None
        if estimate is None:
            return None
        pose, age = estimate.pose, self._clock.age(estimate.stamp_ns, self._loop.time())
        return {"name": self.name, "x": pose.x, "y": pose.y, "heading": pose.heading,
                "footprint": self._fixed.get("footprint", []), "age": round(age or 0.0, 1)}  # fmt: skip

    def age(self, frame: Frame) -> float | None:
        """Age of what a frame shows, s."""
        return self._clock.age(frame.stamp_ns, self._loop.time())

    # --- acting -----------------------------------------------------------------------------------------------------

    async def stop(self) -> None:
        """Stop the robot. Requests that come while one is under way share the next one.

        Raises:
            NavloomError: The robot could not be stopped.
        """
        if self._next_stop is None:
            self._next_stop = asyncio.create_task(self._stop_once())
        await asyncio.shield(self._next_stop)

    async def _stop_once(self) -> None:
        async with self._stopping:
            self._next_stop = None
            robot = self._there()
            await self._on(self._stops, robot.stop)

    async def act(self, do: Callable[[Navigator], T]) -> T:
        """Do something with the robot, on a thread. Raises NavloomError."""
        robot = self._there()
        return await self._on(self._acts, lambda: do(robot))

    async def look(self, do: Callable[[Navigator], T]) -> T:
        """Ask something that needs no more than a viewer's certificate. Raises NavloomError."""
        robot = self._reader
        if robot is None:
            raise ClientError(f"robot {self.name} is not there: `navloom doctor` says why")
        return await self._on(self._acts, lambda: do(robot))

    async def with_driver(self, do: Callable[[Driver], Awaitable[None]], releases: Callable[[], bool]) -> None:
        """Drive the robot by hand, over a connection that is closed afterwards.

        Args:
            do: Drives.
            releases: Whether the robot goes on by itself afterwards; otherwise its gate stops it until `resume`.

        Raises:
            NavloomError: The robot cannot be driven.
        """
        self._there()
        stack = ExitStack()
        try:
            robot = await self._on(self._acts, lambda: stack.enter_context(self.where.navigator()))
            driver = robot.driving()
            await self._on(self._acts, driver.__enter__)
            try:
                await do(driver)
            finally:
                if releases():
                    await self._on(self._acts, lambda: driver.__exit__(None, None, None))
        finally:
            await self._on(self._acts, stack.close)

    async def _on(self, pool: ThreadPoolExecutor, do: Callable[[], T]) -> T:
        return await self._loop.run_in_executor(pool, do)

    def _there(self) -> Navigator:
        if self._acting is None:
            raise ClientError(f"robot {self.name} is not there: `navloom doctor` says why")
        if not self.may_operate:
            raise DirectoryError(f"robot {self.name}: the dashboard's certificate may only look; start it with an "
                                 "operator's, as --keys keys/operator.pem")  # fmt: skip
        return self._acting


def _shown(streams: list[str]) -> list[str]:
    """The streams that the page needs, of all."""
    return [stream for stream in streams if stream.rpartition("/")[2] not in UNREAD]


def _fixed(robot: Navigator) -> tuple[dict[str, Any], str]:
    """What does not change while the robot is up; and where its poses are."""
    config = robot.config().config
    table = config.robot
    world = " ".join((table.realm, *(one.ref for one in (config.map, config.world) if one is not None)))
    return {
        "footprint": robot.footprint().round(4).tolist(),
        "height": table.height,
        "limits": {
            "v": table.max_linear, "w": table.max_angular, "acceleration": table.max_acceleration,
            "deceleration": table.max_deceleration, "drive": table.drive,
        },
        "gate": {"stop_deadline": config.gate.stop_deadline},
        "plugins": {role: Discovery().names(role) for role in ROLES},
    }, world  # fmt: skip


def _load(node: Any) -> dict[str, Any]:
    """How busy a node is."""
    return {"node": f"{node.role} {node.instance}", "process": node.process, "host": node.host, "step": node.step_s,
            "period": node.period_s, "late_ticks": node.late_ticks, "ticks": node.ticks}  # fmt: skip
