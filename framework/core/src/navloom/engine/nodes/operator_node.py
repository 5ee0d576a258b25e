"""The node that publishes the requests of operators."""

from __future__ import annotations

from navloom.engine.node_ports import Output
from navloom.engine.nodes.node_base import Node, Tick
from navloom.engine.streams import OperatorPorts
from navloom.messages import OperatorRequest

__all__ = ["OperatorNode"]


class OperatorNode(Node):
    """Publishes the operators' requests of this tick."""

    role = "operator"
    ticks = True
    request = Output(OperatorPorts.request)
    command = Output(OperatorPorts.command)

    def __init__(self) -> None:
        self.requests: list[OperatorRequest] = []

    def step(self, tick: Tick) -> None:
        for request in self.requests:
            self.request.put(request)
        self.requests = []
