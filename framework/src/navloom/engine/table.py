"""The node table of navloom: users write no wiring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from navloom.engine.ports import Input, NodeSpec

__all__ = ["node_table"]


def node_table(sensors: Sequence[str], wired: Mapping[str, Sequence[str]]) -> list[NodeSpec]:
    """Every node with its wiring.

    Args:
        sensors: Names of all sensors: ports of the platform.
        wired: By role, the sensors it gets (localizer, mapper, avoider, recovery, gate).
    """

    def scans(role: str, triggers: bool = False) -> tuple[Input, ...]:
        return tuple(Input(f"scan.{name}", "platform", name, "new", triggers=triggers) for name in wired.get(role, ()))

    pose = Input("pose", "localizer", "pose")
    map_sensors = scans("mapper", triggers=True) or (Input("odometry", "platform", "odometry", triggers=True),)
    avoider_sensors = wired.get("avoider", ())
    return [
        NodeSpec("operator", (), ("request", "command"), ticks=True),
        NodeSpec(
            "platform",
            (Input("command", "gate", "command", delayed=True), Input("sweep", "goal", "sweep", "new", delayed=True)),
            ("odometry", *sensors, "contact", "truth"),
            ticks=True,
        ),
        NodeSpec(
            "localizer",
            (
                Input("odometry", "platform", "odometry", triggers=True),
                *scans("localizer"),
                Input("map", "mapper", "map", delayed=True),
            ),
            ("pose",),
            cause="odometry",
        ),
        NodeSpec(
            "mapper",
            (
                *map_sensors,
                Input("track", "localizer", "pose", "track"),
                Input("clear", "goal", "clear", "new", delayed=True, triggers=True),
            ),
            ("map",),
            cause="track",
        ),
        NodeSpec(
            "goal",
            (
                Input("request", "operator", "request", "new"),
                pose,
                Input("map", "mapper", "map"),
                Input("path", "planner", "path", delayed=True),
                Input("failure", "planner", "failure", delayed=True),
                Input("reference", "reference", "reference", delayed=True),
                Input("trajectory", "reference", "trajectory", delayed=True),
                Input("avoider", "avoider", "status", delayed=True),
                Input("handover", "avoider", "handover", delayed=True),
                Input("recovery", "recovery", "status", "new", delayed=True),
                Input("gate", "gate", "status", delayed=True),
                Input("selection", "gate", "selection", delayed=True),
            ),
            ("plan", "sweep", "recovery", "clear", "drive", "feedback", "result"),
            cause="pose",
            ticks=True,
        ),
        NodeSpec(
            "planner",
            (Input("plan", "goal", "plan", "new", triggers=True), Input("map", "mapper", "map")),
            ("path", "failure"),
            cause="plan",
        ),
        NodeSpec(
            "reference",
            (Input("path", "planner", "path"), pose, Input("drive", "goal", "drive")),
            ("trajectory", "reference"),
            cause="pose",
            ticks=True,
        ),
        NodeSpec(
            "controller",
            (
                Input("reference", "reference", "reference", triggers=True),
                Input("trajectory", "reference", "trajectory"),
                pose,
            ),
            ("command",),
            cause="reference",
        ),
        NodeSpec(
            "avoider",
            (
                Input("desired", "controller", "command", triggers=True),
                *scans("avoider"),
                pose,
                Input("reference", "reference", "reference"),
                Input("gate", "gate", "status", delayed=True),
            ),
            ("command", "status", "handover"),
            cause="pose",
        ),
        NodeSpec(
            "recovery",
            (Input("request", "goal", "recovery", delayed=True), *scans("recovery"), pose),
            ("command", "status"),
            cause="pose",
            ticks=True,
        ),
        NodeSpec(
            "gate",
            (
                Input("request", "operator", "request", "new"),
                Input("odometry", "platform", "odometry", "offers"),
                Input("contact", "platform", "contact"),
                *(Input(f"required.{name}", "platform", name, "offers") for name in avoider_sensors),
                *scans("gate"),
                Input("operator", "operator", "command", "offers"),
                Input("drive", "goal", "drive"),
                Input("recovering", "goal", "recovery", delayed=True),
                Input("controller", "controller", "command", "offers"),
                Input("avoider", "avoider", "command", "offers"),
                Input("handover", "avoider", "handover"),
                Input("recovery", "recovery", "command", "offers"),
            ),
            ("command", "status", "selection"),
            ticks=True,
        ),
    ]
