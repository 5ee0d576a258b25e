"""The same message, live and in a bag: both are refused for the same reason; the docs have the table."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import ros_bags as bags
from navloom_recording.recording_header import RecordingError
from navloom_ros.bag_import import import_bag
from navloom_ros.base import sources
from navloom_ros.base.readings import Anchor
from ros_heard import Said

PAGE = Path(__file__).parents[3] / "docs" / "importing.md"
START = bags.START_NS
ECHOES = np.linspace(1.0, 3.0, 181)
STEP = math.pi / 180.0
"""Angle between two beams, rad."""
FLAT, TAIL = math.sin(0.25), math.cos(0.25)
"""Half the sine and cosine of 0.5 rad, 29°."""


def scan(bag: bags.Bag, **changed: Any) -> Any:
    message = bag.scan(changed.pop("ranges", ECHOES), START, changed.pop("frame", "laser"))
    return dataclasses.replace(message, **changed)


def odometry(bag: bags.Bag, child: str = "base_link", w: float = 1.0, vx: float = 0.5) -> Any:
    message = bag.odometry(0.0, START)
    message.child_frame_id, message.pose.pose.orientation.w, message.twist.twist.linear.x = child, w, vx
    return message


def sonar(bag: bags.Bag, **changed: Any) -> Any:
    return dataclasses.replace(bag.range(1.5, START), **changed)


def leaning(bag: bags.Bag, axis: str) -> Any:
    message = bag.transform("base_link", "laser", 0.2, 0.0, START)
    turn = message.transforms[0].transform.rotation
    turn.w = TAIL
    setattr(turn, axis, FLAT)
    return message


CASES: dict[str, Any] = {
    "`range_max` 0": lambda bag: {"/scan": scan(bag, range_max=0.0)},
    "`range_min` above `range_max`": lambda bag: {"/scan": scan(bag, range_min=11.0)},
    "a limit that is NaN": lambda bag: {"/scan": scan(bag, range_max=math.nan)},
    "`angle_increment` 0": lambda bag: {"/scan": scan(bag, angle_increment=0.0)},
    "angles in degrees": lambda bag: {"/scan": scan(bag, angle_min=-90.0, angle_max=90.0, angle_increment=1.0)},
    "twice the ranges of the angles": lambda bag: {"/scan": scan(bag, ranges=np.tile(ECHOES, 2), angle_increment=STEP)},
    "`time_increment` below 0": lambda bag: {"/scan": scan(bag, time_increment=-0.1)},
    "ranges and limits in mm": lambda bag: {"/scan": scan(bag, ranges=ECHOES * 1000.0, range_max=12000.0)},
    "ranges in mm, limits in m": lambda bag: {"/scan": scan(bag, ranges=ECHOES * 1000.0)},
    "no range is a measurement": lambda bag: {"/scan": scan(bag, ranges=np.full(181, math.nan))},
    "the laser is tilted by 29°": lambda bag: {"/scan": scan(bag), "/tf_static": leaning(bag, "x")},
    "no transform to the laser": lambda bag: {"/scan": scan(bag, frame="nowhere")},
    "a transform that is no rotation": lambda bag: {"/scan": scan(bag), "/tf_static": bag_zero(bag)},
    "a `Range` of NaN": lambda bag: {"/sonar": sonar(bag, range=math.nan)},
    "a `Range` with `max_range` 0": lambda bag: {"/sonar": sonar(bag, min_range=0.0, max_range=0.0)},
    "a `Range` in mm": lambda bag: {"/sonar": sonar(bag, range=1500.0, max_range=4000.0)},
    "a `Range` that points down by 29°": lambda bag: {"/sonar": sonar(bag), "/tf_static": leaning(bag, "y")},
    "odometry of a frame elsewhere": lambda bag: {"/odom": odometry(bag, "laser")},
    "odometry of an unknown frame": lambda bag: {"/odom": odometry(bag, "camera")},
    "odometry with a quaternion of 0": lambda bag: {"/odom": odometry(bag, w=0.0)},
    "odometry with a velocity of NaN": lambda bag: {"/odom": odometry(bag, vx=math.nan)},
}  # fmt: skip


def bag_zero(bag: bags.Bag) -> Any:
    message = bag.transform("base_link", "laser", 0.2, 0.0, START)
    message.transforms[0].transform.rotation.w = 0.0
    return message


def messages(bag: bags.Bag, case: str) -> dict[str, Any]:
    """Messages by topic: a good robot, and what the case changes."""
    changed: dict[str, Any] = CASES[case](bag)
    good = {"/tf_static": bag.transform("base_link", "laser", 0.2, 0.5, START), "/odom": odometry(bag)}
    ranges = {} if {"/scan", "/sonar"} & set(changed) else {"/scan": scan(bag)}
    return good | ranges | changed


def why_live(case: str) -> str:
    """The reason that `ros2_base` gives for the messages; empty if it takes them."""
    bag = bags.Bag.__new__(bags.Bag)
    bag.store = bags.get_typestore(bags.Stores.ROS2_HUMBLE)
    bag.ros = 2
    said, given = Said(), messages(bag, case)
    names = {"/tf_static": sources.STATIC, "/odom": sources.ODOMETRY}
    for topic, message in given.items():
        heard = SimpleNamespace(message=message, source_ns=START, gid=b"one", arrived_ns=START)
        said.waiting[names.get(topic, topic)] = [heard]
    robot = sources.Robot(said, "base_link", "odom", Anchor(False, 0.5, 1.0))
    robot.listen(from_tf=False)
    sensor: Any = (
        sources.Ranges(["/sonar"], None, 10**9, False) if "/sonar" in given else sources.Laser("/scan", None, False)
    )
    sensor.read(robot, START)
    return robot.unusable or sensor.feeds[0].why


def why_imported(case: str, folder: Path) -> str:
    """The reason that the import gives for the messages; empty if it takes them."""
    with bags.Bag(folder / "bag", 2) as bag:
        for topic, message in messages(bag, case).items():
            bag.put(topic, message, START)
    try:
        import_bag(folder / "bag", folder / "a.mcap")
    except RecordingError as error:
        text = str(error).partition(", and follow its scans")[0]
        return text.partition("): ")[2] or text.partition("/odom: ")[2]
    return ""


def stem(reason: str) -> str:
    """A reason without the remedy, which differs: a bag cannot be corrected where it was recorded."""
    return reason.partition(": ")[0].partition(";")[0].replace("its frame 'nowhere'", "nowhere").replace("'", "")


@pytest.mark.parametrize("case", CASES)
def test_a_bag_is_refused_for_the_reason_for_which_the_live_platform_refuses_the_message(
    tmp_path: Path, case: str
) -> None:
    live = why_live(case)
    assert live and stem(why_imported(case, tmp_path)) == stem(live).replace("its frame laser", "laser")


def test_the_table_in_the_docs_is_what_both_say(tmp_path: Path) -> None:
    rows = ["| in a message | live, `ros2_base` | `ros import` |", "|---|---|---|"]
    for number, case in enumerate(CASES):
        folder = tmp_path / str(number)
        folder.mkdir()
        live, imported = why_live(case), why_imported(case, folder)
        rows.append(f"| {case} | {live} | {'the same' if imported == live else imported} |")
    table = "\n".join(rows)
    assert table in PAGE.read_text("utf-8"), f"docs/importing.md needs this table:\n{table}\n"
