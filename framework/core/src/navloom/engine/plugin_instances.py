"""The instances that a config names: their plugins, and the streams and sensors that each of them reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from navloom.config import ConfigError
from navloom.config.config_errors import Gathered
from navloom.config.config_presets import params_of
from navloom.config.schema import Config
from navloom.config.tables import RoleTable
from navloom.engine.catalogue import Catalogue, carries_truth, node_plugin
from navloom.engine.node_graph import GraphError, order
from navloom.engine.node_ports import Declared, NodeSpec, Port, SensorGroup, Wired
from navloom.engine.nodes.node_plugin import NodePlugin
from navloom.messages import Message
from navloom.plugins import Discovery, PluginError
from navloom.plugins.registry import nearest
from navloom.roles import ROLES, Platform, Role, SensorSpec
from navloom.roles.extra import extras_of

__all__ = ["Part", "catalogue_of_parts", "connect", "find_parts", "find_streams", "sensors_of",
           "streams_of"]  # fmt: skip


@dataclass(eq=False)
class Part:
    """One plugin of a run: its place in the config, its class, its parameters, and the object.

    Attributes:
        place: Place of its table in the file.
        role: Role, or name of the node.
        table: Its table.
        cls: Its class.
        params: Its parameters, checked.
        sensors: Names of the sensors it reads.
        streams: By name, the port of each input that names only a message class.
        plugin: The object; None before it is made.
    """

    place: str
    role: str
    table: RoleTable
    cls: type[Role]
    params: Any
    sensors: tuple[str, ...] = ()
    streams: Mapping[str, Port[Any]] = field(default_factory=dict)
    plugin: Role | None = None


def find_parts(config: Config, discovery: Discovery, problems: Gathered) -> dict[tuple[str, str], Part]:
    """Every instance that the config names, by role and name."""
    parts: dict[tuple[str, str], Part] = {}
    for place, role, table in config.role_tables():
        with problems.gather():
            try:
                found = discovery.role(role, table.plugin) if role in ROLES else node_plugin(discovery, table.plugin)
            except PluginError as error:
                raise PluginError(f"{place}.plugin: {error}") from None
            params = params_of(found, table.preset, table.params, place)
            parts[(role, table.instance)] = Part(place, role, table, found, params)
    return parts


def catalogue_of_parts(
    config: Config, parts: Mapping[tuple[str, str], Part], problems: Gathered, moves: bool
) -> Catalogue:
    """The nodes of the robot, in whose simulated world something moves or not.

    An alternative of a node must publish the same streams.
    """
    strangers: dict[str, type[NodePlugin]] = {}
    for table in config.node:
        part = parts.get((table.name, table.instance))
        # Missing parts are already among the problems.
        if part is not None and issubclass(part.cls, NodePlugin):
            strangers[table.name] = part.cls
    for part in parts.values():
        active = strangers.get(part.role)
        if active is not None:
            with problems.gather():
                _check_streams(part, active)
    return Catalogue(strangers, [table.name for table in config.node if table.required], config.roles, moves)


def _check_streams(part: Part, active: type[NodePlugin]) -> None:
    assert issubclass(part.cls, NodePlugin)
    ours, theirs = [{port.name: port.carries for port in cls.ports(Wired(part.role))} for cls in (part.cls, active)]
    if ours != theirs:
        raise ConfigError(
            f"{part.place}.plugin: {part.cls.name} publishes {_listed(ours)}, expected the streams of {active.name}, "
            f"which is active in {part.role}: {_listed(theirs)}"
        )


def _listed(ports: Mapping[str, type[Message]]) -> str:
    return ", ".join(f"{name} ({carries.__name__})" for name, carries in ports.items()) or "nothing"


def sensors_of(part: Part, platform: type[Platform], sensors: tuple[SensorSpec, ...]) -> tuple[str, ...]:
    """Sensors that an instance reads: those its table names, or all whose messages it accepts."""
    gives: Mapping[str, Any] = {sensor.name: platform.sensor_kinds[sensor.kind] for sensor in sensors}
    if part.table.sensors is None:
        return tuple(name for name, message in gives.items() if issubclass(message, part.cls.accepts))
    for name in part.table.sensors:
        if not issubclass(gives[name], part.cls.accepts):
            takes = " and ".join(message.__name__ for message in part.cls.accepts) or "no sensor"
            raise ConfigError(
                f"{part.place}.sensors: {name!r} gives {gives[name].__name__}, {part.cls.name} takes {takes}"
            )
    return tuple(part.table.sensors)


def find_streams(part: Part, ports: Sequence[Port[Any]]) -> dict[str, Port[Any]]:
    """The port of each input of a plugin that names only a message class; an optional one may have none.

    Args:
        part: The plugin.
        ports: Every port of the robot.

    Raises:
        ConfigError: There are several ports of the class, or none for an input that is not optional, or the table's
            `inputs` do not fit.
    """
    wanted = dict(_wanted(part.cls))
    chosen = part.table.inputs or {}
    for name in chosen:
        if name not in wanted:
            hint = nearest(name, list(wanted)) if wanted else "; it declares none"
            raise ConfigError(f"{part.place}.inputs.{name}: {part.cls.name} has no such input{hint}")
    # A platform steps first in a tick: there is nothing that it could wait for.
    if wanted and part.role == "platform":
        raise ConfigError(f"{part.place}.plugin: {part.cls.name} declares extra inputs, which a platform cannot have")
    optional = {name for name, extra in extras_of(part.cls).items() if extra.optional}
    return {
        name: _port_of(part, name, carries, chosen.get(name), ports)
        for name, carries in wanted.items()
        if name not in optional or name in chosen or _ports_of(part, carries, ports, is_named=False)
    }


def _wanted(cls: type[Role]) -> Iterator[tuple[str, type[Message]]]:
    """Inputs that name only a message class."""
    for name, extra in extras_of(cls).items():
        yield name, extra.carries
    if issubclass(cls, NodePlugin):
        for declared_input in cls.declared_inputs:
            if isinstance(declared_input, Declared) and (
                declared_input.port is None or carries_truth(declared_input.carries)
            ):
                yield declared_input.name, declared_input.carries


def _port_of(
    part: Part, name: str, carries: type[Message], chosen: str | None, ports: Sequence[Port[Any]]
) -> Port[Any]:
    """The port that one input reads."""
    if carries_truth(carries):
        raise ConfigError(
            f"{part.place}.plugin: {part.cls.name} reads {carries.__name__}: no plugin may read the ground truth"
        )
    found = _ports_of(part, carries, ports, is_named=chosen is not None)
    place, words = f"{part.place}.inputs.{name}", f"{part.cls.name} reads {carries.__name__}"
    listed = ", ".join(found)
    if chosen is not None:
        if chosen not in found:
            known = f"; there are {listed}" if found else ", and there is none"
            raise ConfigError(f'{place}: is "{chosen}", expected a stream of {carries.__name__}{known}')
        return found[chosen]
    if not found:
        if truths := _ports_of(part, carries, ports, is_named=True):
            port = next(iter(truths))
            raise ConfigError(
                f"{place}: {words}, and only {port} publishes it, which tells the truth of the simulator: "
                f'add a node, or name it, as in inputs = {{ {name} = "{port}" }}'
            )
        raise ConfigError(f"{place}: {words}, and no [[node]] or [[sensor]] publishes it: add one that does")
    if len(found) > 1:
        example = f'inputs = {{ {name} = "{next(iter(found))}" }}'
        raise ConfigError(f"{place}: {words}, and there are {listed}: name one, as in {example}")
    return next(iter(found.values()))


def _ports_of(part: Part, carries: type[Message], ports: Sequence[Port[Any]], is_named: bool) -> dict[str, Port[Any]]:
    """The ports of a message class that a plugin may read, by their names: one that tells the truth only if named."""
    # Not its own role: an alternative that reads its active instance would follow it.
    return {
        str(port): port
        for port in ports
        if issubclass(port.carries, carries) and port.role != part.role and (is_named or not port.is_truth)
    }


def streams_of(cls: type[Role]) -> dict[str, dict[str, str]]:
    """What a plugin reads in addition to its role's inputs, and what a node publishes: message classes by name."""
    reads = {name: extra.carries for name, extra in extras_of(cls).items()}
    if not issubclass(cls, NodePlugin):
        return {"reads": {name: carries.__name__ for name, carries in reads.items()}} if reads else {}
    for declared_input in cls.declared_inputs:
        if isinstance(declared_input, Declared):
            reads[declared_input.name] = declared_input.carries
        elif isinstance(declared_input, SensorGroup):
            reads |= {f"{declared_input.name}, of sensors": kind for kind in declared_input.carries or (Message,)}
    publishes = {port.name: port.carries for port in cls.ports(Wired(cls.role))}
    return {
        what: {name: carries.__name__ for name, carries in streams.items()}
        for what, streams in (("reads", reads), ("publishes", publishes))
    }


def connect(
    catalogue: Catalogue, parts: Mapping[tuple[str, str], Part], sensors: Mapping[str, Port[Any]], seen: Sequence[str]
) -> tuple[list[NodeSpec], dict[tuple[str, str], NodeSpec]]:
    """The wiring of every node in the order they step, and of every instance.

    A node's wiring has the inputs of all its instances, since alternatives may read different streams.

    Args:
        catalogue: The nodes.
        parts: The instances; of each role the active one first.
        sensors: Ports of the platform's sensors, by name.
        seen: Names of the sensors that the gate's monitor reads.

    Raises:
        ConfigError: A cycle without a delayed input, printed edge by edge.
    """
    given: dict[str, list[Port[Any]]] = {"gate": [sensors[name] for name in seen]}
    for part in parts.values():
        # A list without repeats, in the order of the config: sets would give another order in each process.
        kept = given.setdefault(part.role, [])
        kept += [sensors[name] for name in part.sensors if sensors[name] not in kept]
    given["platform"] = list(sensors.values())
    specs, wiring = [], {}
    for role, node in catalogue.nodes.items():
        instances: list[NodeSpec] = []
        for part in parts.values():
            if part.role == role:
                # Each instance by its own sensors: alternatives may read different ones.
                own = given if role == "platform" else {**given, role: [sensors[name] for name in part.sensors]}
                cls = part.cls if issubclass(part.cls, NodePlugin) else node
                spec = cls.spec(Wired(role, own, part.streams, extras_of(part.cls), catalogue.absent))
                wiring[role, part.table.instance] = spec
                instances.append(spec)
        if not instances:
            instances = [node.spec(Wired(role, given, absent=catalogue.absent))]
            wiring[role, "main"] = instances[0]
        first = instances[0]
        # The order must hold for whichever instance becomes active.
        inputs = tuple(dict.fromkeys(one for spec in instances for one in spec.inputs))
        specs.append(NodeSpec(role, inputs, first.ports, first.cause, first.ticks))
    try:
        return order(specs), wiring
    except GraphError as error:
        raise ConfigError(f"node: {error}") from None
