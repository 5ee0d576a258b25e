"""The whole config file, and checks across its tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import Field, create_model, model_validator

from navloom.config.config_members import MemberTable, each_member
from navloom.config.config_methods import ALTERNATIVE_INSTEAD, MethodTable, problems_of_method
from navloom.config.tables import (
    DEFAULT_PLUGINS,
    OWN_NODES,
    OWN_PROCESS,
    REQUIRED_ROLES,
    ROLE_TABLES,
    TAKEN,
    WORLD_NODE,
    AlternativeTable,
    EventTable,
    GateTable,
    LiveTable,
    MapTable,
    NavigationTable,
    NodeTable,
    PlacedTable,
    PluginsTable,
    RobotTable,
    RoleTable,
    RunTable,
    SensorTable,
    Table,
    WorldTable,
)
from navloom.plugins.registry import nearest
from navloom.roles import FIXED, ROLES

__all__ = ["Config"]


if TYPE_CHECKING:
    OptionalTables = Table
else:
    OptionalTables = create_model(
        "OptionalTables",
        __base__=Table,
        **{role: (RoleTable | None, None) for role in ROLE_TABLES if role not in REQUIRED_ROLES},
    )
"""The tables of optional roles; None without one."""


class Config(OptionalTables):
    """The whole file."""

    run: RunTable = RunTable()
    robot: RobotTable = RobotTable()
    plugins: PluginsTable = PluginsTable()
    world: WorldTable | None = None
    map: MapTable | None = None
    platform: RoleTable
    localizer: RoleTable
    mapper: RoleTable
    planner: RoleTable
    controller: RoleTable
    avoider: RoleTable
    recovery: RoleTable
    sensor: list[SensorTable] = Field(default_factory=list)
    node: list[NodeTable] = Field(default_factory=list)
    alternative: list[AlternativeTable] = Field(default_factory=list)
    # Not among the values in effect: a method that is not chosen must change no hash and no recording.
    method: list[MethodTable] = Field(default_factory=list, exclude=True)
    # Each member's values in effect are those of its own config.
    member: list[MemberTable] = Field(default_factory=list, exclude=True)
    navigation: NavigationTable = NavigationTable()
    gate: GateTable = GateTable()
    event: list[EventTable] = Field(default_factory=list)
    live: LiveTable = LiveTable()

    @model_validator(mode="before")
    @classmethod
    def _roles_have_plugins(cls, given: Any) -> Any:
        """A table that names no plugin gets the default one; an optional role without a table gets none."""
        # pydantic refuses it with a message of its own.
        if not isinstance(given, dict):
            return given
        roles = {role: given.get(role, {}) for role in DEFAULT_PLUGINS if role in REQUIRED_ROLES or role in given}
        filled = {
            role: {"plugin": DEFAULT_PLUGINS[role], **table} if isinstance(table, dict) else table
            for role, table in roles.items()
        }
        return {**given, **filled}

    @model_validator(mode="before")
    @classmethod
    def _nodes_have_processes(cls, given: Any) -> Any:
        """Optional roles that no process names run where their role says. Node plugins run in a process of their own,
        apart from those that drive the robot."""
        tables, live = (given.get("node", []), given.get("live", {})) if isinstance(given, dict) else (None, None)
        if not isinstance(tables, list) or not isinstance(live, dict):
            return given
        processes = live.get("processes", LiveTable().processes)
        if not isinstance(processes, dict) or not all(isinstance(nodes, list) for nodes in processes.values()):
            return given
        names = [table.get("name") for table in tables if isinstance(table, dict)]
        placed = {node for nodes in processes.values() for node in nodes}
        # Those with a taken name are refused by `_wrong_nodes`; placed, they would be refused for the process instead.
        added = [(name, OWN_PROCESS) for name in names if isinstance(name, str) and name not in TAKEN]
        added += [(role, cls.facts.process) for role, cls in ROLES.items() if cls.facts.is_optional and role in given]
        left = [(name, process) for name, process in added if name not in placed]
        if not left:
            return given
        # A new dict: the given one belongs to the caller, who may show or write it.
        spread = {process: list(nodes) for process, nodes in processes.items()}
        for name, process in left:
            spread.setdefault(process if process in spread else OWN_PROCESS, []).append(name)
        return {**given, "live": {**live, "processes": spread}}

    @model_validator(mode="after")
    def _names_fit(self) -> Config:
        problems = [
            *self._wrong_nodes(),
            *self._wrong_roles(),
            *self._wrong_sensors(),
            *self._wrong_instances(),
            *self._wrong_places(),
            *self._wrong_events(),
            *self._wrong_methods(),
            *self._wrong_members(),
        ]
        # All at once, so that a file is put right in one go.
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _wrong_nodes(self) -> Iterator[str]:
        names = [table.name for table in self.node]
        for number, name in enumerate(names):
            if name in TAKEN:
                yield f'node.{number}.name: "{name}" is a name of the framework; choose another'
            if name in names[:number]:
                yield f'node.{number}.name: two tables [[node]] are named "{name}"'

    def _wrong_roles(self) -> Iterator[str]:
        tables = [(f"alternative.{number}", table.role) for number, table in enumerate(self.alternative)]
        tables += [(f"event.{number}", event.role) for number, event in enumerate(self.event) if event.role]
        for place, role in tables:
            if role not in self.roles:
                hint = f"; {ALTERNATIVE_INSTEAD}" if role == "method" else nearest(role, self.roles)
                yield f'{place}.role: got "{role}", expected a role or the name of a [[node]]{hint}'

    def _wrong_sensors(self) -> Iterator[str]:
        sensors = [sensor.name for sensor in self.sensor]
        for number, sensor in enumerate(sensors):
            if sensor in sensors[:number]:
                yield f'sensor.{number}.name: two tables [[sensor]] are named "{sensor}"'
        for place, _, table in self.role_tables():
            for name in table.sensors or ():
                if name not in sensors:
                    yield f'{place}.sensors: names "{name}"; sensors are {", ".join(sensors) or "none"}'

    def _instances(self) -> set[tuple[str, str]]:
        """Role and name of every instance."""
        active = {(role, self.role_table(role).instance) for role in self.roles}
        return active | {(table.role, table.instance) for table in self.alternative}

    def _wrong_instances(self) -> Iterator[str]:
        taken = {(role, self.role_table(role).instance) for role in self.roles}
        for number, table in enumerate(self.alternative):
            if table.role in FIXED:
                yield f"alternative.{number}.role: is a {table.role}: the {table.role} is never shadowed or swapped"
            elif (table.role, table.instance) in taken:
                yield f'alternative.{number}: two instances of {table.role} are named "{table.instance}": ' \
                      "give one a `name`"  # fmt: skip
            taken.add((table.role, table.instance))

    def _wrong_places(self) -> Iterator[str]:
        taken, known = self._instances(), (*self.roles, *OWN_NODES, WORLD_NODE)
        for process, nodes in self.live.processes.items():
            for node in nodes:
                role, dot, name = node.partition(".")
                if role not in known or (dot and role in (*OWN_NODES, WORLD_NODE)):
                    yield f'live: process {process} names "{node}", expected a role or role.instance of ' \
                          f"{', '.join(known)}"  # fmt: skip
                elif dot and (role, name) not in taken:
                    yield f'live.processes.{process}: names "{node}"; of {role} there are {_names_of(role, taken)}'
        hosted = [process for processes in self.live.hosts.values() for process in processes]
        if hosted and OWN_PROCESS not in hosted and (left := self.live.processes.get(OWN_PROCESS)):
            yield f"live.hosts: no host starts the process {OWN_PROCESS} of {', '.join(left)}: name it under one, or " \
                  "name its nodes in another process"  # fmt: skip

    def _wrong_events(self) -> Iterator[str]:
        taken = self._instances()
        for number, event in enumerate(self.event):
            if event.do in ("swap", "set") and event.name and (event.role, event.name) not in taken:
                known = _names_of(event.role, taken)
                is_method = event.name in [table.name for table in self.method]
                hint = f"; {event.name} is a [[method]]: {ALTERNATIVE_INSTEAD}" if is_method else ""
                yield f'event.{number}.name: names {event.role} "{event.name}"; there are {known}{hint}'
            if event.do == "swap" and event.role in FIXED:
                yield f"event.{number}.role: the {event.role} is never swapped"

    def _wrong_methods(self) -> Iterator[str]:
        names = [table.name for table in self.method]
        for number, table in enumerate(self.method):
            if table.name in names[:number]:
                yield f'method.{number}.name: two tables [[method]] are named "{table.name}"'
            yield from problems_of_method(f"method.{number}.set", table.set, type(self).model_fields)
        if names and any(table.name == "method" for table in self.node):
            yield 'node: one is named "method", as are the tables [[method]] in `--vary`; choose another name'

    def _wrong_members(self) -> Iterator[str]:
        taken: set[str] = set()
        for number, table in enumerate(self.member):
            names = [str(each["name"]) for each in each_member([table.model_dump(include={"name", "count"})])]
            for name in sorted(taken.intersection(names)):
                yield f'member.{number}.name: two tables [[member]] are named "{name}"'
            taken.update(names)

    @property
    def roles(self) -> list[str]:
        """Roles that the robot has, and the names of node plugins."""
        return [*self._own_roles(), *(table.name for table in self.node)]

    def _own_roles(self) -> list[str]:
        return [role for role in ROLE_TABLES if getattr(self, role) is not None]

    def role_table(self, role: str) -> RoleTable:
        """The table of the active instance of a role or node."""
        table = next((table for table in self.node if table.name == role), None) or getattr(self, role)
        # For mypy, to which getattr() gives Any.
        assert isinstance(table, RoleTable)
        return table

    def role_tables(self) -> list[PlacedTable]:
        """The table of every instance; initially active ones come first."""
        return [
            *(PlacedTable(role, role, self.role_table(role)) for role in self._own_roles()),
            *(PlacedTable(f"node.{number}", table.name, table) for number, table in enumerate(self.node)),
            *(PlacedTable(f"alternative.{number}", table.role, table) for number, table in enumerate(self.alternative)),
        ]

    def without(self, nodes: Collection[str]) -> Config:
        """This config without some node plugins and everything that names them."""
        # Without the unset keys: an event refuses keys that its `do` has no use for, even at their defaults.
        tree = self.model_dump(mode="json", exclude_unset=True)
        tree["node"] = [table for table in tree.get("node", []) if table["name"] not in nodes]
        for tables in ("alternative", "event"):
            tree[tables] = [table for table in tree.get(tables, []) if table.get("role") not in nodes]
        if "processes" in tree.get("live", {}):
            spread: Mapping[str, list[str]] = tree["live"]["processes"]
            left = {
                process: [node for node in placed if node.partition(".")[0] not in nodes]
                for process, placed in spread.items()
            }
            tree["live"]["processes"] = left
        return Config.model_validate(tree)


def _names_of(role: str | None, instances: set[tuple[str, str]]) -> str:
    """Names of a role's instances, for a message."""
    return ", ".join(name for owner, name in sorted(instances) if owner == role)
