"""The node of the command gate (`navigation.command_gate`), which also keeps the selection of active instances."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from navloom.engine.node_ports import Dated, Latest, New, Offers, Output, SensorOffers, Sensors
from navloom.engine.nodes.executor_inputs import GateTold, Obeyed, gone_text
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import (
    AvoiderPorts,
    ControllerPorts,
    GatePorts,
    GoalPorts,
    LocalizerPorts,
    MapperPorts,
    OperatorPorts,
    PlatformPorts,
    RecoveryPorts,
    WorldPorts,
)
from navloom.messages import (
    GateStatus,
    Message,
    OperatorRequest,
    RangeScan,
    Selection,
    StopReason,
    TrackingCommand,
    Twist2D,
)
from navloom.messages.motion import Command
from navloom.navigation.command_gate import STOPPED, CommandGate, Offer, Sensed

__all__ = ["LIVE_LEAD", "GateNode"]

LIVE_LEAD = 2
"""Ticks by which a live gate announces a selection, so that every host knows it when it begins to apply."""


class GateNode(Node):
    """Connects the command gate to its ports, and keeps the selection of active instances.

    Args:
        gate: Decides on each command.
        selected: Active instance, by role, at the start.
        is_warm: Whether an instance has published its role's result, so that it can take over.

    Attributes:
        cause_ns: Platform stamp that the last command derives from.
        lead: Ticks from the announcement of a selection to the first tick in which it applies; more when live, since
            the message has to arrive.
        now_ns: Live: what the platform's clock shows now; None if the newest stamp is the time.
        is_silent, gone, late: Live: see `Sensed`.
        find_waiting: Set by the executor: returns which node waits for which stream; empty for none.
        obeyed: Live: requests that came through a service since the last step.
        has_new_platform: Live: the platform restarted since the last look at its messages.
    """

    role = "gate"
    ticks = True
    hears = "rivals"
    request = New(OperatorPorts.request)
    odometry = Offers(PlatformPorts.odometry)
    contact = Latest(PlatformPorts.contact)
    # Only when it was made: a robot must not drive on among bodies that have stopped with their node.
    bodies = Offers(WorldPorts.bodies)
    # The avoider's own sensors: one that the active avoider does not read need not stop the robot.
    required = SensorOffers(Message, of="avoider")
    scans = Sensors(RangeScan)
    pose = Latest(LocalizerPorts.pose)
    # Not the mapper's own map: made while driving, it comes from the same scans, with the errors of raster and pose on
    # top.
    known = Latest(MapperPorts.known)
    operator = Offers(OperatorPorts.command)
    drive = Latest(GoalPorts.drive)
    # Of the previous tick, in which the recovery itself has seen the request: its first command is then there.
    recovering = Latest(GoalPorts.recovery, delayed=True)
    controller = Offers(ControllerPorts.command)
    avoider = Offers(AvoiderPorts.command)
    handover = Latest(AvoiderPorts.handover)
    recovery = Offers(RecoveryPorts.command)
    command = Output(GatePorts.command)
    status = Output(GatePorts.status)
    selection = Output(GatePorts.selection)

    def __init__(self, gate: CommandGate, selected: dict[str, str], is_warm: Callable[[str, str], bool]) -> None:
        self.gate = gate
        self.selected = dict(selected)
        self.is_warm = is_warm
        self.epoch = 0
        self.cause_ns = 0
        self.lead = 1
        self.now_ns: int | None = None
        self.is_silent = False
        self.gone: StopReason | None = None
        self.late = ""
        self.find_waiting: Callable[[], str] = lambda: ""
        self.obeyed: list[Obeyed] = []
        self.has_new_platform = False
        self._has_forgotten = False
        self._warm: list[str] = []
        self._waiting = ""
        self._pending: dict[str, str] = {}
        self._status: GateStatus | None = None
        self._released: object = None
        self._has_selected = False
        self._from_tick = 0

    def step(self, tick: Tick) -> None:
        has_contact = self.gate.has_contact
        for request in self.request.values:
            self.obey(request, self.operator.value)
        if self._take_over(tick.number) or not self._has_selected:
            self._has_selected = True
            # The first selection is that of the config, which every process knows.
            self._from_tick = tick.number + self.lead if self.epoch else 0
            chosen = tuple(f"{role} {name}" for role, name in sorted(self.selected.items()))
            self.selection.put(Selection(self.epoch, self._from_tick, chosen))
        sensed = self._sensed()
        self._see()
        twist, self.cause_ns, status = self.gate.decide(
            sensed, self._offers(tick.epoch), self._is_engaged(), tick.epoch, self.pending
        )
        self.command.put(Command(twist))
        # The monitor must know what is on its way to the wheels when it judges the next command.
        self._gave(twist, sensed.platform_ns)
        # Identity first, as the gate returns the same object in most ticks.
        if status is not self._status and status != self._status:
            self._status = status
            self.status.put(status)
        self._note(has_contact)

    def check(self, tick: Tick) -> None:
        """Between two ticks: stop at once if something is wrong; does nothing if all is well or already stopped.

        The ramp of an ordinary stop begins and continues with the ticks. Only a latched stop is published at once: one
        that was not published is not remembered.
        """
        sensed, has_contact = self._sensed(), self.gate.has_contact
        # Always, also if the robot is stopped: scans that were not seen now would be too old in the next tick.
        has_seen = self._see()
        reason = self.gate.choose(sensed, self._offers(tick.epoch), self._is_engaged(), tick.epoch)[2]
        said = self._status
        ramps = self.gate.ramps(reason, sensed)
        if reason is not None and ramps and said is not None and said.latched != self.gate.is_latched:
            self._note(has_contact)
            said = self._status = self.gate.announce(reason, self.pending)
            self.status.put(said)
        if reason is None or ramps:
            if said is not None and has_seen:
                self._look_again(said, sensed.platform_ns)
        # Only the first time: a stop is repeated by the ticks, not by every look.
        elif said is None or not said.stopped or said.latched != self.gate.is_latched:
            self._note(has_contact)
            self.stop(reason, sensed.platform_ns)

    def stop(self, reason: StopReason, platform_ns: int) -> None:
        """Publish a zero command and a status with the reason."""
        self.cause_ns = platform_ns
        self._status = self.gate.stop(reason, self.pending)
        self._gave(STOPPED, platform_ns)
        self.command.put(Command(STOPPED))
        self.status.put(self._status)

    def restore(self, epoch: int, selected: dict[str, str], latched: str) -> None:
        """Continue from an earlier gate: its selection, under a newer epoch, and its latched stop, as a text."""
        # A newer epoch, so that commands made under the earlier gate are refused.
        self.epoch = epoch + 1
        self.selected |= selected
        self.gate.latch(StopReason.parse(latched))

    def begin_anew(self) -> None:
        """The run clock restarted: the current selection applies from tick 0."""
        self._from_tick = 0

    @property
    def pending(self) -> list[str]:
        """Pending swaps, as "role instance", sorted by role."""
        return [f"{role} {name}" for role, name in sorted(self._pending.items())] if self._pending else []

    def obey(self, request: OperatorRequest, driving: Command | None) -> None:
        """Take an operator's request; `driving` is the newest command of an operator who drives."""
        if request.do in ("stop", "resume", "release", "enter_unseen"):
            self.gate.request(request.do)
        if request.do in ("release", "resume"):
            # The operator's command stays the newest on its port: released, this very one no longer drives.
            self._released = driving
        elif request.do == "swap":
            if self.selected.get(request.role) != request.instance:
                self._pending[request.role] = request.instance
            else:
                # A swap back to the active instance cancels the pending one.
                self._pending.pop(request.role, None)

    def _take_over(self, number: int) -> bool:
        """Select the pending instances that are warm, once the previous selection applies; True if there are any."""
        # The next selection is announced only when this one applies, or hosts would see them in another order.
        if number < self._from_tick:
            return False
        if not self._pending:
            self._warm = []
            return False
        warm = [role for role, name in self._pending.items() if self.is_warm(role, name)]
        self._warm = [f"{role} {self._pending[role]}" for role in warm]
        for role in warm:
            self.selected[role] = self._pending.pop(role)
        self.epoch += bool(warm)
        return bool(warm)

    def _note(self, has_contact: bool) -> None:
        if self.now_ns is None and not self._warm and not self._waiting:
            self.told = ""
            return
        self.told = GateTold(
            self.now_ns, self.is_silent, gone_text(self.gone), tuple(self.obeyed), has_contact, tuple(self._warm),
            self._waiting, self._has_forgotten, self.late, self.gate.speed_limit,
        ).text  # fmt: skip
        self.obeyed, self._warm, self._has_forgotten = [], [], False

    def _look_again(self, said: GateStatus, platform_ns: int) -> None:
        """Publish a new command and status if a scan between two ticks changes them."""
        found = self.gate.look_again(said, platform_ns * 1e-9)
        if found is None:
            return
        twist, self._status = found
        self._gave(twist, platform_ns)
        self._note(self.gate.has_contact)
        self.command.put(Command(twist))
        self.status.put(self._status)

    def _see(self) -> bool:
        """Pass new odometry, scans, pose and known map to the collision monitor; True if there was a scan.

        A restarted platform may stand anywhere: what the monitor knows from before does not hold for it.
        """
        monitor, odometry = self.gate.monitor, self.odometry.value
        if monitor is None or odometry is None:
            return False
        if self.has_new_platform:
            self.has_new_platform, self._has_forgotten = False, True
            # Stamps need not show it: a platform that restarts quickly may continue its clock.
            monitor.forget()
        monitor.move(odometry)
        monitor.locate(self.pose.value, self.known.value)
        # A list, not a generator: every scan must be looked at, also after the first new one.
        news = [monitor.look(f"scan.{name}", scan) for name, scans in self.scans.items() for scan in scans.values]
        return any(news)

    def _gave(self, twist: Twist2D, time_ns: int) -> None:
        if self.gate.monitor is not None:
            self.gate.monitor.give(time_ns * 1e-9, twist)

    def _sensed(self) -> Sensed:
        contact = self.contact.value
        newest = _stamp_ns(self.odometry)
        if self.now_ns is not None:
            # The extrapolated clock may lag behind a message that has just arrived.
            newest = max(newest, self.now_ns)
        stamps = {name: _stamp_ns(one) for name, one in self.required.items()}
        if self.bodies.when is not None:
            stamps["bodies"] = _stamp_ns(self.bodies)
        is_touching = contact is not None and contact.touching
        self._waiting = self.find_waiting()
        return Sensed(newest, is_touching, stamps, self.is_silent, self.gone, self._waiting, self.late)

    def _offers(self, epoch: int) -> dict[str, Offer | None]:
        drive, recovering, operator = self.drive.value, self.recovering.value, self.operator.value
        offers: dict[str, Offer | None] = {}
        # By identity: the same velocity may be commanded again after a release.
        if operator is not None and operator is not self._released:
            offers["operator"] = self._offer("operator", self.operator, epoch)
        # A recovery replaces controller and avoider; an operator stays above it.
        if recovering is not None and recovering.active:
            offers["recovery"] = self._offer("recovery", self.recovery, epoch)
        elif drive is not None and drive.path_id:
            offers["controller"] = self._offer("controller", self.controller, epoch)
            offers["avoider"] = self._offer("avoider", self.avoider, epoch)
        return offers

    def _offer(self, role: str, held: Dated[Command | TrackingCommand], epoch: int) -> Offer | None:
        """A command as an offer. The epoch of one made before the selection applied is not checked."""
        message, when = held.value, held.when
        if message is None or when is None:
            return None
        tick, _, cause_ns, made_under = when
        return Offer(
            self.selected.get(role, "main"), message.twist, cause_ns, made_under if tick >= self._from_tick else epoch
        )

    def _is_engaged(self) -> bool:
        handover = self.handover.value
        return handover is not None and handover.engaged


def _stamp_ns(held: Dated[Any]) -> int:
    """Run clock of the newest message; 0 before the first."""
    when = held.when
    return 0 if when is None else when[1]
