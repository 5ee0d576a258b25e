"""Order of the node table, and what is wrong with others."""

from __future__ import annotations

import pytest
from navloom.engine.graph import GraphError, order
from navloom.engine.ports import Input, NodeSpec
from navloom.engine.random_streams import stream_source
from navloom.engine.table import node_table

WIRED = {"mapper": ("laser",), "avoider": ("sonars",)}


def test_the_table_steps_upstream_first() -> None:
    roles = [spec.role for spec in order(node_table(["laser", "sonars"], WIRED))]
    assert roles == ["operator", "platform", "localizer", "mapper", "goal", "planner", "reference", "controller",
                     "avoider", "recovery", "gate"]  # fmt: skip


def test_a_cycle_without_a_delayed_edge_is_printed_edge_by_edge() -> None:
    specs = [
        NodeSpec("a", (Input("x", "b", "out"),), ("out",)),
        NodeSpec("b", (Input("y", "a", "out"),), ("out",)),
    ]
    with pytest.raises(GraphError) as caught:
        order(specs)
    assert "a reads b.out" in str(caught.value) and "b reads a.out" in str(caught.value)


def test_a_delayed_edge_breaks_the_cycle() -> None:
    specs = [
        NodeSpec("a", (Input("x", "b", "out", delayed=True),), ("out",)),
        NodeSpec("b", (Input("y", "a", "out"),), ("out",)),
    ]
    assert [spec.role for spec in order(specs)] == ["a", "b"]


def test_an_input_that_leads_nowhere_names_both_ends_and_the_nearest_port() -> None:
    with pytest.raises(
        GraphError, match=r"mapper reads platform\.lasr, but platform publishes no 'lasr'; did you mean 'laser'"
    ):
        order(node_table(["laser"], {"mapper": ("lasr",)}))
    with pytest.raises(GraphError, match="there is no node 'platfrm'; did you mean 'platform'"):
        order(
            [*node_table(["laser"], WIRED | {"avoider": ("laser",)}), NodeSpec("x", (Input("y", "platfrm", "p"),), ())]
        )


def test_a_stream_depends_on_its_names_alone() -> None:
    first = stream_source(7, "platform", "sim")("sonars").random(3)
    source = stream_source(7, "platform", "sim")
    source("laser").random(100)
    assert (source("sonars").random(3) == first).all()
    assert (stream_source(7, "platform", "other")("sonars").random(3) != first).all()
    assert (stream_source(8, "platform", "sim")("sonars").random(3) != first).all()


def test_a_stream_asked_for_again_goes_on() -> None:
    source = stream_source(7, "platform", "sim")
    assert source("sonars") is source("sonars")
