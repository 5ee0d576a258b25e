"""Typed ports: nodes are wired as their classes declare, and the type checker finds a wrong wire."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from navloom.engine.catalogue import FRAMEWORK, NODES
from navloom.engine.node_ports import Latest, Output, Wired
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.nodes.planner_node import PlannerNode
from navloom.engine.streams import ControllerPorts, LocalizerPorts, PlannerPorts


def test_a_node_is_wired_as_its_class_declares() -> None:
    spec = PlannerNode.spec(Wired("planner"))
    assert [str(given) for given in spec.inputs] == ["goal.plan", "mapper.map", "mapper.known"]
    assert spec.outputs == ("path", "failure") and spec.cause == "plan" and not spec.ticks


def test_facts_about_roles_come_from_the_ports() -> None:
    known = FRAMEWORK
    needed = {"world", "platform", "localizer", "reference", "controller", "avoider", "goal"}
    assert set(known.required_roles()) == needed
    assert known.answer_ports("planner") == ("path", "failure") and known.answer_ports("recovery") == ("command",)
    assert known.warming_ports("recovery") == () and known.warming_ports("mapper") == ("map",)
    assert known.nodes["mapper"].patience > known.nodes["controller"].patience
    assert {port.role for port in known.ports()} == {node.role for node in NODES}


def test_a_node_publishes_only_on_ports_of_its_own_role() -> None:
    with pytest.raises(TypeError, match=r"Wrong\.command is the port controller\.command, expected one of 'planner'"):

        class Wrong(Node):
            role = "planner"
            command = Output(ControllerPorts.command)


def test_an_input_that_is_not_wired_says_so() -> None:
    class Lonely(Node):
        role = "planner"
        pose = Latest(LocalizerPorts.pose)
        path = Output(PlannerPorts.path)

        def step(self, tick: Tick) -> None:
            assert self.pose.value is not None

    with pytest.raises(AttributeError, match=r"Lonely\.pose is not wired yet"):
        Lonely().step(Tick(0, 0.0, 0, 0))


WRONG = """
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.node_ports import Latest, Output
from navloom.engine.streams import ControllerPorts, LocalizerPorts
from navloom.messages import Command, Path, Twist2D

class Wrong(Node):
    role = "controller"
    pose = Latest(LocalizerPorts.pose)
    command = Output(ControllerPorts.command)

    def step(self, tick: Tick) -> None:
        path: Path | None = self.pose.value
        self.command.put(Command(Twist2D(0.0, 0.0, 0.0)))
"""


@pytest.mark.once
def test_a_wrongly_typed_wire_fails_mypy(tmp_path: Path) -> None:
    source = tmp_path / "wrong.py"
    source.write_text(WRONG, "utf-8")
    checked = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(source)], capture_output=True, text=True
    )
    assert 'has type "PoseEstimate | None", variable has type "Path | None"' in checked.stdout, checked
    assert 'has incompatible type "Command"; expected "TrackingCommand"' in checked.stdout
