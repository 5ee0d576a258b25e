"""What all nodes have in common: their ports as attributes, and one step that reads and publishes on them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

from navloom.engine.node_ports import Declared, Group, NodeSpec, Out, Output, Port, SensorOutputs, Silence, Wired
from navloom.messages import Message

if TYPE_CHECKING:
    from navloom.config.tables import NavigationTable
    from navloom.geometry.world import World
    from navloom.roles import RobotSpec, SensorSpec

__all__ = ["Node", "NodeSettings", "Outputs", "Tick"]

Outputs = list[tuple[Out[Any], Message]]
SIBLING_WAIT = 0.005


class Tick(NamedTuple):
    """When a step takes place.

    Attributes:
        number: Number of the tick, from 0.
        time: Run clock, s.
        time_ns: Run clock, ns.
        epoch: Number of the current selection of active instances.
    """

    number: int
    time: float
    time_ns: int
    epoch: int


@dataclass(frozen=True)
class NodeSettings:
    """What the node around a plugin may take from the config beside the plugin.

    Attributes:
        navigation: The config's `[navigation]`.
        robot: The robot.
        tolerance: How near to its goal the robot must come, m.
        sensors: The config's sensors.
        map_world: The world of the known map; None without one.
        name: Name of the robot.
    """

    navigation: NavigationTable
    robot: RobotSpec
    tolerance: float
    sensors: tuple[SensorSpec, ...]
    map_world: World | None = None
    name: str = ""


class Node(ABC):
    """A node of the graph. A subclass declares its inputs and outputs as class attributes and implements `step`.

    Class attributes:
        role: Role, or the name of a framework node.
        ticks: It steps in every tick; otherwise only an input that triggers makes it step.
        cause: Input whose Platform stamp its outputs derive from; None for the platform itself.
        is_awaited: Live: nodes that read it wait a moment for its step of the same tick.
        hears: Live: step reports that it acts on besides those of nodes it waits for. "rivals": reports of the goal and
            of roles that have several instances; "faults": all reports of a fault.
        answers_when_asked: It publishes only on request, so an instance can take over before it has published anything.
        patience: Live: how long a step waits for other inputs of the trigger's tick, s.

    Attributes:
        made: What the current step has published so far.
        told: What the executor told the node in addition to its inputs of the last step, as text for the step record.
    """

    # Properties of a whole role belong here and not to a port: they hold for each of its streams.
    role: ClassVar[str] = ""
    ticks: ClassVar[bool] = False
    cause: ClassVar[Any] = None
    is_awaited: ClassVar[bool] = False
    hears: ClassVar[Literal["", "rivals", "faults"]] = ""
    answers_when_asked: ClassVar[bool] = False
    patience: ClassVar[float] = SIBLING_WAIT
    declared_inputs: ClassVar[tuple[Declared[Any, Any] | Group[Any], ...]] = ()
    declared_outputs: ClassVar[tuple[Output[Any] | SensorOutputs, ...]] = ()
    made: Outputs
    told: str = ""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        # Bases first, so that a subclass can replace a declaration; `cause` is only a second name for one of them.
        declared = {
            name: var for base in reversed(cls.__mro__) for name, var in vars(base).items() if name != "cause"
        }.values()
        cls.declared_inputs = tuple(one for one in declared if isinstance(one, (Declared, Group)))
        cls.declared_outputs = tuple(one for one in declared if isinstance(one, (Output, SensorOutputs)))
        for output in cls.declared_outputs:
            if isinstance(output, Output) and output.port.role not in ("", cls.role):
                raise TypeError(f"{cls.__name__}.{output.name} is the port {output.port}, expected one of {cls.role!r}")

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        node = super().__new__(cls)
        # In `__new__`, because a plugin's `__init__` need not call that of its base.
        node.made = []
        for output in cls.declared_outputs:
            if isinstance(output, Output):
                node.__dict__[output.name] = Out(output.port.name, node)
        return node

    @classmethod
    def around(cls, plugin: Any, settings: NodeSettings) -> Self:
        """The node around a plugin of its role."""
        return cls(plugin)

    @classmethod
    def ports(cls, wired: Wired) -> list[Port[Any]]:
        """What it publishes on."""
        ports: list[Port[Any]] = []
        for output in cls.declared_outputs:
            if isinstance(output, Output):
                ports.append(output.port if output.port.role else output.port.of(wired.role))
            else:
                ports += wired.sensors.get(wired.role, ())
        return ports

    @classmethod
    def spec(cls, wired: Wired) -> NodeSpec:
        """The node's wiring for a config."""
        inputs = tuple(given for declared_input in cls.declared_inputs for given in declared_input.inputs(wired))
        cause = "" if cls.cause is None else cls.cause.name
        return NodeSpec(wired.role, inputs, tuple(cls.ports(wired)), cause, cls.ticks)

    def wire(self, spec: NodeSpec, wires: Mapping[str, Any]) -> None:
        """Bind each input to its wire, by name, and create the output ports of its sensors."""
        for declared_input in self.declared_inputs:
            if isinstance(declared_input, Declared) and declared_input.name not in wires:
                self.__dict__[declared_input.name] = Silence()
            elif isinstance(declared_input, Declared):
                wires[declared_input.name].bind(self.__dict__, declared_input.name)
            else:
                group: dict[str, Any] = {}
                self.__dict__[declared_input.name] = group
                for given in spec.inputs:
                    if declared_input.has(given):
                        wires[given.name].bind(group, given.name.partition(".")[2])
        # What is left of the outputs are the ports of sensors, whose names only the config knows.
        fixed = {output.port.name for output in self.declared_outputs if isinstance(output, Output)}
        for other in self.declared_outputs:
            if isinstance(other, SensorOutputs):
                names = [name for name in spec.outputs if name not in fixed]
                self.__dict__[other.name] = {name: Out(name, self) for name in names}

    def outs(self) -> list[Out[Any]]:
        """All its ports."""
        found: list[Out[Any]] = []
        for output in self.declared_outputs:
            held = self.__dict__[output.name]
            found += [held] if isinstance(output, Output) else held.values()
        return found

    @abstractmethod
    def step(self, tick: Tick) -> None:
        """Read the inputs, and publish on the outputs."""
