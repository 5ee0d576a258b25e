"""The node around a localizer."""

from __future__ import annotations

from contextlib import nullcontext, suppress

import numpy as np

from navloom.engine.answer_checks import LocalizerDoor
from navloom.engine.node_ports import Latest, OtherSensors, Output, Sensors
from navloom.engine.nodes.executor_inputs import LocalizerTold, place_of
from navloom.engine.nodes.node_base import Tick
from navloom.engine.nodes.role_node import RANGES, RoleNode, in_order, readings_of
from navloom.engine.streams import LocalizerPorts, MapperPorts, PlatformPorts
from navloom.messages import Hypotheses, MapUpdate, OperatorRequest, Pose2D
from navloom.roles import Localizer, LocalizerInput
from navloom.roles.base import InputError

__all__ = ["LocalizerNode"]


class LocalizerNode(RoleNode[Localizer]):
    """Turns odometry and scans into a pose in the map."""

    role = "localizer"
    is_awaited = True
    odometry = Latest(PlatformPorts.odometry, triggers=True)
    scans = Sensors(RANGES)
    readings = OtherSensors(RANGES)
    # Of the previous tick, since the mapper reads this node's poses.
    map = Latest(MapperPorts.map, delayed=True)
    known = Latest(MapperPorts.known, delayed=True)
    pose = Output(LocalizerPorts.pose)
    hypotheses = Output(LocalizerPorts.hypotheses)
    cause = odometry

    def __init__(self, plugin: Localizer) -> None:
        self.plugin = plugin
        self.door = LocalizerDoor(plugin)
        self._known: MapUpdate | None = None
        self._hypotheses: Hypotheses | None = None
        self._obeyed: list[OperatorRequest] = []

    def obey(self, request: OperatorRequest) -> None:
        """Obey a request that came through a service, which no port carries; see `place`."""
        self.place(request, is_active=True)
        self._obeyed.append(request)

    def place(self, request: OperatorRequest, is_active: bool) -> None:
        """Obey an operator's "place" or "relocalise", between two steps.

        Raises:
            InputError: The plugin accepts no place, or cannot search, and it is the active one.
        """
        goal, pose = request.goal, None
        if goal is not None:
            assert goal.heading is not None
            pose = Pose2D(goal.x, goal.y, goal.heading)
        # A shadow that accepts no place must not refuse the operator's request.
        with nullcontext() if is_active else suppress(InputError):
            if pose is None:
                self.plugin.search()
            elif request.spread is None or request.heading_spread is None:
                self.plugin.place(pose)
            else:
                self.plugin.search(pose, (request.spread, request.heading_spread))

    def step(self, tick: Tick) -> None:
        self.told = LocalizerTold(tuple([place_of(one) for one in self._obeyed])).text if self._obeyed else ""
        self._obeyed.clear()
        odometry = self.odometry.value
        assert odometry is not None
        scans, names = in_order(self.scans)
        known = self.known.value
        # Made once for each map: the message would otherwise be built in every tick.
        if known is not None and (self._known is None or self._known.grid is not known):
            self._known = MapUpdate(tick.time_ns, known, np.empty((0, 4)), ())
        # With a known map, never the mapper's: a localizer would match what was marked from its own poses.
        map = self.map.value if known is None else self._known
        seen = LocalizerInput(odometry, scans, map, names, readings_of(self.readings), self.extra(), known)
        self.pose.put(self.door.check(self.plugin.localize(seen), seen))
        places = self.plugin.hypotheses()
        # By identity, as for the mapper's known map.
        if places is not None and places is not self._hypotheses:
            self._hypotheses = places
            self.hypotheses.put(self.door.check_places(places))
