"""What may be registered, and the messages that refuse the rest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from navloom.config.tables import AlternativeTable, NodeTable
from navloom.engine.nodes.node_plugin import NodePlugin, Tick
from navloom.geometry.world import World
from navloom.messages import Message, PlanFailure, Point2D
from navloom.plugins import PluginError, Registry
from navloom.plugins.registry import nearest
from navloom.roles import ROLE_API, ROLES, Params, Planner, PlannerInput, Role
from navloom.roles.base import RESERVED_KEYS


class Nowhere(Planner):
    name = "nowhere"

    def plan(self, given: PlannerInput) -> PlanFailure:
        return PlanFailure(given.request.request_id, "no_path", Point2D(0.0, 0.0), "never")


def test_a_class_is_kept_by_its_role_and_name() -> None:
    registry = Registry()
    registry.add(Nowhere)
    registry.add(Nowhere)
    assert registry.roles == {("planner", "nowhere"): Nowhere}


def test_every_role_has_a_version_and_its_own_name() -> None:
    assert list(ROLES) == ["platform", "localizer", "mapper", "planner", "controller", "avoider", "recovery"]
    assert dict.fromkeys(ROLES, 1) == ROLE_API


def test_another_version_of_the_role_is_refused_by_name_with_both_versions() -> None:
    newer = type("Newer", (Nowhere,), {"name": "newer", "api": 2})
    with pytest.raises(PluginError, match=r"planner\.newer is built for version 2 of the role planner, .* version 1"):
        Registry().add(newer)


class Rootless(Role):
    name = "rootless"


class Silent(Planner):
    name = "silent"


def nameless() -> type[Role]:
    return type("Nameless", (Nowhere,), {})


@pytest.mark.parametrize(
    "given",
    [Nowhere.plan, "Nowhere", None, int, Rootless, Role, Planner, nameless()],
    ids=lambda given: getattr(given, "__qualname__", str(given)),
)
def test_an_object_that_is_no_named_class_of_a_role_is_refused(given: Any) -> None:
    with pytest.raises(PluginError, match="expected a subclass of a role"):
        Registry().add(given)


def test_a_class_without_the_verb_of_its_role_is_refused() -> None:
    with pytest.raises(PluginError, match=r"planner\.silent does not implement plan$"):
        Registry().add(Silent)


@pytest.mark.parametrize(
    ("part", "text"),
    [
        ({"Params": int}, "its Params is <class 'int'>, expected a subclass of navloom.Params"),
        ({"accepts": ("laser",)}, "its accepts is ('laser',), expected a tuple of message classes, as (RangeScan,)"),
        ({"warm_up": lambda self: None}, "its warm_up is called on the class: put @classmethod before it"),
        (
            {"__init__": lambda self: None},
            "its __init__ is given params and context (too many positional arguments): "
            "`def __init__(self, params, context)`",
        ),
    ],
    ids=lambda given: next(iter(given)) if isinstance(given, dict) else "",
)
def test_a_class_with_a_part_that_cannot_be_used_is_refused(part: dict[str, Any], text: str) -> None:
    with pytest.raises(PluginError) as refused:
        Registry().add(type("Wrong", (Nowhere,), {"name": "wrong", **part}))
    assert str(refused.value) == f"planner.wrong: {text}"


def test_two_classes_of_one_name_are_refused() -> None:
    registry = Registry()
    registry.add(Nowhere)
    with pytest.raises(PluginError, match=r"planner\.nowhere is registered twice"):
        registry.add(type("Other", (Nowhere,), {"name": "nowhere"}))


def test_worlds_and_schemes_of_one_name_are_refused() -> None:
    def make() -> World:
        return World("hall")

    def load(argument: str, base: Path) -> World:
        return World(argument)

    registry = Registry()
    registry.world("hall", make)
    registry.world_scheme("file", load)
    with pytest.raises(PluginError, match="world 'hall' is registered twice"):
        registry.world("hall", make)
    with pytest.raises(PluginError, match="world scheme 'file' is registered twice"):
        registry.world_scheme("file", load)
    assert (registry.worlds, registry.schemes) == ({"hall": make}, {"file": load})


class Ticking(NodePlugin):
    """A node that does nothing each tick."""

    name = "ticking"
    ticks = True

    def step(self, tick: Tick) -> None:
        """Nothing is published."""


def test_nodes_and_messages_are_kept_by_their_names() -> None:
    registry = Registry()
    registry.node(Ticking)
    registry.message(Point2D)
    registry.message(Point2D)
    assert (registry.nodes, registry.messages) == ({"ticking": Ticking}, {"Point2D": Point2D})
    with pytest.raises(PluginError, match="node 'ticking' is registered twice"):
        registry.node(type("Other", (Ticking,), {"name": "ticking"}))


def test_a_node_of_another_version_and_one_without_a_step_are_refused() -> None:
    with pytest.raises(
        PluginError, match=r"node\.old is built for version 7 of nodes, this framework speaks version 1"
    ):
        Registry().node(type("Old", (Ticking,), {"name": "old", "api": 7}))
    with pytest.raises(PluginError, match=r"node\.lazy does not implement step"):
        Registry().node(type("Lazy", (NodePlugin,), {"name": "lazy", "ticks": True}))
    with pytest.raises(TypeError, match="Idle never steps: set ticks = True, or triggers=True on one of its inputs"):
        type("Idle", (NodePlugin,), {"name": "idle"})


@pytest.mark.parametrize("given", [Nowhere.plan, "Nowhere", nameless, object])
def test_an_object_that_is_no_class_of_a_node_is_refused(given: Any) -> None:
    with pytest.raises(PluginError, match=r"expected a subclass of navloom\.NodePlugin with a `name`"):
        Registry().node(given)


@pytest.mark.parametrize("given", [Nowhere, Message, type("Bare", (Message,), {}), Point2D(0.0, 0.0)])
def test_a_class_that_is_no_declared_message_is_refused(given: Any) -> None:
    with pytest.raises(PluginError, match=r"expected a subclass of navloom\.Message, declared with @message"):
        Registry().message(given)


@pytest.mark.parametrize(
    ("name", "known", "expected"),
    [
        ("atsar", ["astar", "jps"], "; did you mean 'astar'?"),
        ("xyz", ["jps", "astar"], "; known are astar, jps"),
        ("xyz", [], "; none is installed"),
    ],
)
def test_the_nearest_name_is_offered_or_all_of_them(name: str, known: list[str], expected: str) -> None:
    assert nearest(name, known) == expected


@pytest.mark.parametrize("name", RESERVED_KEYS)
def test_a_parameter_that_no_config_could_set_is_refused(name: str) -> None:
    params = type("Taken", (Params,), {"__annotations__": {name: float}, name: 1.0})
    with pytest.raises(
        PluginError, match=rf"planner\.wrong: its Params has a field {name}, which is a key of the frame"
    ):
        Registry().add(type("Wrong", (Nowhere,), {"name": "wrong", "Params": params}))


def test_the_reserved_keys_are_those_of_the_roles_tables() -> None:
    assert set(RESERVED_KEYS) == {*AlternativeTable.model_fields, *NodeTable.model_fields}
