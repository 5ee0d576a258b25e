"""Ports: the streams that a role publishes, each declared once, and the declarations of a node's inputs and outputs.

A message can be followed from the line that makes it to the lines that read it: `Output(LocalizerPorts.pose)` in the
node that publishes, `Latest(LocalizerPorts.pose)` in the nodes that read. Both are typed by what the port carries.
These declarations give the order of the steps, the quality of service, what late joiners receive and which streams
driving requires.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, Literal, Protocol, Self, TypeVar, overload

from navloom.messages import Message
from navloom.roles.extra import Extra

__all__ = ["Dated", "Declared", "ExtraInputs", "Group", "Held", "Input", "Latest", "New", "News", "NodeSpec",
           "Offers", "OtherSensors", "Out", "Output", "Port", "Ports", "Quality", "Reading",
           "SensorGroup", "SensorOffers", "SensorOutputs", "Sensors", "Silence", "Track", "When", "Wired"]  # fmt: skip

M = TypeVar("M", bound=Message)
B = TypeVar("B")
"""What replaces a declaration on a wired node."""
M_co = TypeVar("M_co", bound=Message, covariant=True)

When = tuple[int, int, int, int]
"""Tick, run clock, cause and epoch of an envelope: all messages of one step share them."""
Congestion = Literal["drop", "block", "block_first"]
Priority = Literal["real_time", "interactive_high", "interactive_low", "data_high", "data", "data_low", "background"]
Reading = Literal["latest", "new", "track", "offers"]
"""How a port is read.

- latest: the newest message, or None.
- new: the messages since the node's last step, oldest first.
- track: the newest messages up to a bound, read before or not, oldest first; valid during the step only.
- offers: the newest message of the active instance and when it was made; for the gate.
"""


@dataclass(frozen=True)
class Quality:
    """Quality of service of one stream.

    Attributes:
        congestion: What happens to a message when a link within one host is full.
        priority: Which queue of the link the message waits in.
        off_host: What happens to a message when a link to another host is full.
    """

    congestion: Congestion
    priority: Priority
    off_host: Congestion


class Port(Generic[M]):
    """A stream that a role publishes: a class attribute of the role's `Ports`, named like the attribute.

    Args:
        carries: The message class.
        quality: Quality of service between processes.
        retained: Late joiners receive the last message.
        required: The robot does not drive without the role's active instance.
        answers: This stream is the role's result: alternatives are compared by it, and an instance that has published
            it can take over.

    Attributes:
        offset_ns: What readers add to the stamps of its messages, ns: the sensor's `time_offset`.
        is_truth: It tells the truth of a simulator: only an input that names it reads it.
    """

    __slots__ = ("answers", "carries", "is_truth", "name", "offset_ns", "quality", "required", "retained", "role")

    def __init__(
        self,
        carries: type[M],
        quality: Quality,
        *,
        retained: bool = False,
        required: bool = False,
        answers: bool = False,
    ) -> None:
        self.carries, self.quality = carries, quality
        self.retained, self.required, self.answers = retained, required, answers
        self.role = self.name = ""
        self.offset_ns = 0
        self.is_truth = False

    def __str__(self) -> str:
        return f"{self.role}.{self.name}"

    def of(self, role: str) -> Port[M]:
        """A copy of this port for a node that a config names."""
        made = Port(self.carries, self.quality, retained=self.retained, required=self.required, answers=self.answers)
        made.role, made.name = role, self.name
        return made


class Ports:
    """Base of a role's ports: `class PlannerPorts(Ports, role="planner")`."""

    role: ClassVar[str]

    def __init_subclass__(cls, role: str) -> None:
        cls.role = role
        for name, port in vars(cls).items():
            if isinstance(port, Port):
                port.role, port.name = role, name

    @classmethod
    def declared(cls) -> list[Port[Any]]:
        """The ports of this role, in the order of their declaration."""
        return [port for port in vars(cls).values() if isinstance(port, Port)]


@dataclass(frozen=True)
class Input:
    """One input of a node, as wired for a config.

    Attributes:
        name: Name of the input in the node.
        source: The port, read from the active instance.
        reading: How it is read.
        delayed: `~`: read as published up to the end of the previous tick.
        triggers: A new message makes the node step.
        is_needed: The node does not step before the first message of this input.
    """

    name: str
    source: Port[Any]
    reading: Reading = "latest"
    delayed: bool = False
    triggers: bool = False
    is_needed: bool = False

    @property
    def role(self) -> str:
        """Role that publishes it."""
        return self.source.role

    @property
    def port(self) -> str:
        """Name of the port."""
        return self.source.name

    def __str__(self) -> str:
        return f"{'~' if self.delayed else ''}{self.source}"


@dataclass(frozen=True)
class NodeSpec:
    """A node's class as wired for a config.

    Attributes:
        role: Role, or the framework's own node: operator, goal, reference, gate.
        inputs: What it reads.
        ports: What it publishes on.
        cause: Input whose Platform stamp its outputs derive from; empty for the platform itself.
        ticks: It steps in every tick; otherwise only a trigger makes it step.
    """

    role: str
    inputs: tuple[Input, ...]
    ports: tuple[Port[Any], ...]
    cause: str = ""
    ticks: bool = False

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of its ports."""
        return tuple([port.name for port in self.ports])


@dataclass(frozen=True)
class Wired:
    """What a node's declarations are wired to by a config.

    Attributes:
        role: Name of the node.
        sensors: By role, the ports of the sensors it reads; for the platform, all sensors.
        streams: By name, the port found for each input that names only a message class.
        extras: Extra inputs of its plugin, by name.
        absent: Optional roles that the robot lacks: what a node reads from them is silent.
    """

    role: str
    sensors: Mapping[str, Sequence[Port[Any]]] = field(default_factory=dict)
    streams: Mapping[str, Port[Any]] = field(default_factory=dict)
    extras: Mapping[str, Extra[Any]] = field(default_factory=dict)
    absent: Collection[str] = ()


class Held(Protocol[M_co]):
    """An input that is read as the newest message."""

    @property
    def value(self) -> M_co | None:
        """The newest message that may be read in this step; None before the first."""


class News(Protocol[M_co]):
    """An input that is read as a sequence of messages."""

    @property
    def values(self) -> Sequence[M_co]:
        """Messages of this step, oldest first."""


class Dated(Held[M_co], Protocol[M_co]):
    """An input that is read as the newest message and when it was made."""

    @property
    def when(self) -> When | None:
        """Tick, run clock, cause and epoch of the newest message's envelope; None before the first."""


class _Attribute(Generic[B]):
    """Base of the declarations: the class attribute is the declaration, a wired node has an attribute in its place."""

    name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = self.name or name  # `cause = pose` calls this a second time

    @overload
    def __get__(self, node: None, owner: type) -> Self: ...

    @overload
    def __get__(self, node: object, owner: type) -> B: ...

    def __get__(self, node: object, owner: type) -> Self | B:
        if node is None:
            return self
        # On a wired node an instance attribute hides this one.
        raise AttributeError(f"{type(node).__name__}.{self.name} is not wired yet")


class Silence:
    """What a node reads in place of an input from an optional role that the robot lacks: never a message."""

    value = None
    values: Sequence[Message] = ()
    when: When | None = None


class Declared(_Attribute[B], Generic[M, B]):
    """Base of the inputs that a node's class declares: a class attribute, whose name is the input's name.

    Args:
        source: The port; or a message class, if the config chooses the port of that class.
        delayed: It is read as published up to the end of the previous tick.
        triggers: A new message makes the node step.

    Attributes:
        port: The port; None where only the message class is named.
        carries: The message class.
    """

    reading: ClassVar[Reading]

    def __init__(self, source: Port[M] | type[M], *, delayed: bool = False, triggers: bool = False) -> None:
        self.port = source if isinstance(source, Port) else None
        self.carries: type[M] = source.carries if isinstance(source, Port) else source
        self.delayed, self.triggers = delayed, triggers

    def inputs(self, wired: Wired) -> Iterator[Input]:
        """The input as wired for a config; none if the robot lacks the role that publishes it."""
        port = wired.streams[self.name] if self.port is None else self.port
        if port.role not in wired.absent:
            yield Input(self.name, port, self.reading, self.delayed, self.triggers)


class Latest(Declared[M, Held[M]]):
    """The newest message."""

    reading = "latest"


class New(Declared[M, News[M]]):
    """The messages since the previous step."""

    reading = "new"


class Track(Declared[M, News[M]]):
    """The newest messages, read before or not; the sequence is valid during the step only."""

    reading = "track"


class Offers(Declared[M, Dated[M]]):
    """The newest message with when it was made."""

    reading = "offers"


class Group(_Attribute[Mapping[str, B]]):
    """Base of a group of inputs whose number the config decides: inputs named `prefix.name`."""

    prefix: ClassVar[str]

    def inputs(self, wired: Wired) -> Iterator[Input]:
        """The inputs as wired for a config."""
        raise NotImplementedError

    def has(self, given: Input) -> bool:
        """Whether an input is one of the group."""
        return given.name.startswith(f"{self.prefix}.")


class SensorGroup(Group[B], Generic[M, B]):
    """Base of a group of inputs from sensors.

    Args:
        carries: Message class of the sensors to read; default: every sensor of the node.
        triggers: Each message makes the node step.
        of: Role whose sensors are read; default: the node's own.
        otherwise: Port that triggers the node if there is no sensor.
    """

    reading: ClassVar[Reading]

    def __init__(
        self,
        carries: type[M] | tuple[type[M], ...] = (),
        *,
        triggers: bool = False,
        of: str = "",
        otherwise: Port[Any] | None = None,
    ) -> None:
        self.carries: tuple[type[M], ...] = carries if isinstance(carries, tuple) else (carries,)
        self.triggers, self.of, self.otherwise = triggers, of, otherwise

    def takes(self, carried: type[Message]) -> bool:
        """Whether the group reads sensors that give this message class."""
        return not self.carries or issubclass(carried, self.carries)

    def has(self, given: Input) -> bool:
        return super().has(given) and self.takes(given.source.carries)

    def inputs(self, wired: Wired) -> Iterator[Input]:
        """One input for each sensor, or `otherwise` if there is none."""
        ports = [port for port in wired.sensors.get(self.of or wired.role, ()) if self.takes(port.carries)]
        for port in ports:
            yield Input(f"{self.prefix}.{port.name}", port, self.reading, triggers=self.triggers)
        if not ports and self.otherwise is not None and self.otherwise.role not in wired.absent:
            yield Input(self.otherwise.name, self.otherwise, triggers=self.triggers)


class Sensors(SensorGroup[M, News[M]]):
    """New messages of the node's sensors, by the sensor's name."""

    reading, prefix = "new", "scan"


class OtherSensors(Sensors[Message]):
    """New messages of all the node's sensors except those of some message classes."""

    prefix = "reading"

    def takes(self, carried: type[Message]) -> bool:
        return not super().takes(carried)


class SensorOffers(SensorGroup[M, Dated[M]]):
    """The newest message of each sensor, with when it was made, by the sensor's name."""

    reading, prefix = "offers", "required"


class ExtraInputs(Group[Held[Message]]):
    """The newest message of each extra input that a node's plugin declares, by its name; not of optional ones that
    nothing publishes.
    """

    prefix = "extra"

    def inputs(self, wired: Wired) -> Iterator[Input]:
        for name, extra in wired.extras.items():
            port = wired.streams.get(name)
            if port is not None:
                yield Input(f"{self.prefix}.{name}", port, delayed=extra.delayed, is_needed=not extra.optional)


class Out(Generic[M]):
    """A port of one node, ready to be published on.

    Attributes:
        name: Name of the port.
        slot: Holds the messages in an executor that passes references; None in others.
    """

    __slots__ = ("_node", "name", "slot")

    def __init__(self, name: str, node: Any) -> None:
        self.name = name
        self.slot: Any = None
        self._node = node

    def put(self, message: M) -> None:
        """Publish a message at the end of this step."""
        self._node.made.append((self, message))


class Output(_Attribute[Out[M]], Generic[M]):
    """A port that a node's class publishes on."""

    def __init__(self, port: Port[M]) -> None:
        self.port = port


class SensorOutputs(_Attribute[Mapping[str, Out[Any]]]):
    """The ports of a platform's sensors, by the sensor's name."""
