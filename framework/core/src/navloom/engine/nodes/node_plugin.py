"""Node plugins: whole nodes of other distributions, with the framework's own declarations of inputs and outputs."""

from __future__ import annotations

from typing import Any, ClassVar, Self, TypeVar

from navloom.engine.node_ports import Declared, Latest, New, Out, Output, Port, Quality, SensorGroup, Sensors, Track
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import (
    PLAIN,
    AvoiderPorts,
    ControllerPorts,
    GatePorts,
    GoalPorts,
    LocalizerPorts,
    MapperPorts,
    OperatorPorts,
    PlannerPorts,
    PlatformPorts,
    RecoveryPorts,
    ReferencePorts,
)
from navloom.messages import Message
from navloom.roles import Role
from navloom.roles.base import P

__all__ = ["AvoiderPorts", "ControllerPorts", "GatePorts", "GoalPorts", "Latest", "LocalizerPorts", "MapperPorts",
           "New", "NodePlugin", "OperatorPorts", "PlannerPorts", "PlatformPorts", "Publishes", "Quality",
           "RecoveryPorts", "ReferencePorts", "Sensors", "Tick", "Track"]  # fmt: skip

M = TypeVar("M", bound=Message)


class Publishes(Output[M]):
    """A stream of a node plugin, named like the attribute.

    Args:
        carries: The message class.
        quality: Quality of service between processes; default: normal priority, late messages are dropped.
        retained: Late joiners receive the last message.
    """

    def __init__(self, carries: type[M], quality: Quality = PLAIN, *, retained: bool = False) -> None:
        super().__init__(Port(carries, quality, retained=retained))

    def __set_name__(self, owner: type, name: str) -> None:
        # The port gets its role later, when a config names the node.
        super().__set_name__(owner, name)
        self.port.name = self.name


class NodePlugin(Role[P], Node):
    """Base of whole nodes of other distributions. A `[[node]]` table of a config uses one and gives it a name.

    A subclass declares what it reads (`Latest`, `New`, `Track` of a message class or port, `Sensors` of a message
    class) and what it publishes (`Publishes`) as class attributes, and implements `step`. Like any plugin it has no
    thread, clock or socket.

    Class attributes, in addition to those of a role's plugin:
        ticks: It steps in every tick; otherwise an input must have `triggers=True`.
        cause: Input whose Platform stamp its outputs derive from; default: its first trigger, or the odometry if it
            steps in every tick.
        is_awaited: Live: nodes that read it wait up to 5 ms for its step of the same tick.
        answers_when_asked: It publishes only on request, so an instance can take over before it has published anything.

    The first stream is the node's result: alternatives are compared by it, and can take over once they have published
    it.
    """

    role = "node"
    accepts: ClassVar[tuple[type[Message], ...]] = ()

    def __init_subclass__(cls) -> None:
        if cls.ticks and cls.cause is None:
            # A node that steps by ticks has no trigger, but the gate must know how old its outputs are.
            cls.paced_by = Latest(PlatformPorts.odometry)  # type: ignore[attr-defined]
            cls.cause = cls.paced_by  # type: ignore[attr-defined]
            cls.cause.__set_name__(cls, "paced_by")
        super().__init_subclass__()
        inputs, outputs = cls.declared_inputs, [output for output in cls.declared_outputs if isinstance(output, Output)]
        triggers = [given for given in inputs if getattr(given, "triggers", False)]
        if hasattr(cls, "name") and not cls.ticks and not triggers:
            raise TypeError(f"{cls.__name__} never steps: set ticks = True, or triggers=True on one of its inputs")
        if cls.cause is None:
            cls.cause = next((trigger for trigger in triggers if isinstance(trigger, Declared)), None)
        if outputs:
            # By order, so that most nodes need not declare it.
            outputs[0].port.answers = True
        cls.accepts = tuple(
            kind for given in inputs if isinstance(given, SensorGroup) for kind in given.carries or (Message,)
        )

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        node = super().__new__(cls, *args, **kwargs)
        for output in cls.declared_outputs:
            if isinstance(output, Output):
                node.__dict__[output.name] = _CheckedOut(output.port, node)
        return node


class _CheckedOut(Out[Message]):
    """A port that refuses messages of another class in the line that publishes them."""

    __slots__ = ("_carries",)

    def __init__(self, port: Port[Any], node: Any) -> None:
        super().__init__(port.name, node)
        self._carries = port.carries

    def put(self, message: Message) -> None:
        """Publish a message at the end of this step. Raises TypeError for one of another class."""
        # mypy does not see the plugins of strangers: a wrong message would fail in another process, at the codec.
        if message.__class__ is not self._carries and not isinstance(message, self._carries):
            raise TypeError(f"{self.name} carries {self._carries.__name__}, got {type(message).__name__}")
        super().put(message)
