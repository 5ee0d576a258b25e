"""Order of the nodes, and errors in the graph."""

from __future__ import annotations

from typing import Any

import pytest
from navloom.engine.catalogue import FRAMEWORK
from navloom.engine.node_graph import GraphError, order
from navloom.engine.node_ports import Input, NodeSpec, Port, Wired
from navloom.engine.random_streams import stream_source
from navloom.engine.streams import PLAIN, sensor_port
from navloom.messages import Command, Message, PoseEstimate, RangeScan

LASER, SONARS = sensor_port("laser", RangeScan), sensor_port("sonars", RangeScan)


def port(role: str, name: str, kind: type[Message] = Command) -> Port[Message]:
    made: Port[Message] = Port(kind, PLAIN)
    made.role, made.name = role, name
    return made


def specs_of(sensors: dict[str, list[Port[Any]]]) -> list[NodeSpec]:
    """Every node of the framework, with these sensors by role."""
    return [node.spec(Wired(role, sensors)) for role, node in FRAMEWORK.nodes.items()]


A, B = port("a", "out"), port("b", "out")


def test_the_catalogue_steps_upstream_first() -> None:
    wired = {"platform": [LASER, SONARS], "mapper": [LASER], "avoider": [SONARS]}
    roles = [spec.role for spec in order(specs_of(wired))]
    assert roles == ["operator", "world", "platform", "localizer", "mapper", "goal", "planner", "reference",
                     "controller", "avoider", "recovery", "gate"]  # fmt: skip


def test_a_cycle_without_a_delayed_edge_is_printed_edge_by_edge() -> None:
    specs = [NodeSpec("a", (Input("x", B),), (A,)), NodeSpec("b", (Input("y", A),), (B,))]
    with pytest.raises(GraphError) as caught:
        order(specs)
    assert "a reads b.out" in str(caught.value) and "b reads a.out" in str(caught.value)


def test_a_delayed_edge_breaks_the_cycle() -> None:
    specs = [NodeSpec("a", (Input("x", B, delayed=True),), (A,)), NodeSpec("b", (Input("y", A),), (B,))]
    assert [spec.role for spec in order(specs)] == ["a", "b"]


def test_an_input_that_leads_nowhere_names_both_ends_and_the_nearest_port() -> None:
    with pytest.raises(
        GraphError, match=r"mapper reads platform\.lasr, but platform publishes no 'lasr'; did you mean 'laser'"
    ):
        order(specs_of({"platform": [LASER], "mapper": [port("platform", "lasr", RangeScan)]}))
    lost = NodeSpec("x", (Input("y", port("platfrm", "p")),), ())
    with pytest.raises(GraphError, match="there is no node 'platfrm'; did you mean 'platform'"):
        order([*specs_of({"platform": [LASER], "mapper": [LASER]}), lost])


def test_a_wire_of_another_type_is_refused() -> None:
    wrong = NodeSpec("x", (Input("where", port("localizer", "pose", Command)),), ())
    with pytest.raises(GraphError, match=r"x reads localizer\.pose as Command, but it carries PoseEstimate"):
        order([*specs_of({"platform": [LASER], "mapper": [LASER]}), wrong])
    right = NodeSpec("x", (Input("where", port("localizer", "pose", PoseEstimate)),), ())
    assert order([*specs_of({"platform": [LASER], "mapper": [LASER]}), right])[-1].role in ("gate", "x")


def test_a_random_stream_depends_only_on_its_names() -> None:
    first = stream_source(7, "platform", "sim")("sonars").random(3)
    source = stream_source(7, "platform", "sim")
    source("laser").random(100)
    assert (source("sonars").random(3) == first).all()
    assert (stream_source(7, "platform", "other")("sonars").random(3) != first).all()
    assert (stream_source(8, "platform", "sim")("sonars").random(3) != first).all()


def test_a_random_stream_that_is_requested_again_continues() -> None:
    source = stream_source(7, "platform", "sim")
    assert source("sonars") is source("sonars")
