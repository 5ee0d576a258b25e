"""The README's examples run unchanged, except for the router's address."""

import re
from pathlib import Path

import pytest
from navloom_ros.node import Node
from navloom_ros.qos import SENSOR
from ros_golden import KILTED
from ros_network import Router

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_there_are_the_examples():
    assert len(BLOCKS) == 2 and "tcp/127.0.0.1:7447" in BLOCKS[1]


@pytest.mark.parametrize("block", BLOCKS, ids=["messages", "network"])
def test_an_example_runs(block):
    with Router() as router, Node("robot", router=router.endpoint, types=KILTED) as robot:
        robot.publisher("scan", "sensor_msgs/msg/LaserScan", SENSOR)
        exec(block.replace("tcp/127.0.0.1:7447", router.endpoint), {})


def test_every_module_that_is_named_is_there():
    package = Path(__file__).parents[1] / "src" / "navloom_ros"
    for module, attribute in re.findall(r"`(\w+)\.(?!cpp|py)(\w+)(?:\.\w+)?`", README):
        if (package / f"{module}.py").exists():
            assert re.search(
                rf"^(class|def) {attribute}\b", (package / f"{module}.py").read_text("utf-8"), re.MULTILINE
            )
