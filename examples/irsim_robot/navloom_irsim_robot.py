"""A robot in the simulator ir-sim. The scene is ir-sim's own YAML, and the config of the robot has no [world]."""

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from navloom import (
    Box,
    Contact,
    Context,
    Cylinder,
    Odometry,
    Params,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    RangeScan,
    Registry,
    Truth,
    Twist2D,
    World,
    hookimpl,
)
from pydantic import Field


class IrsimParams(Params):
    """Parameters of the robot."""

    scene: str = Field("hall.yaml", description="Scene of ir-sim: a file beside this module, or an absolute path.")


class IrsimRobot(Platform[IrsimParams]):
    """The first robot of a scene: ir-sim moves it and reads its laser."""

    name = "irsim_robot"
    is_simulated = True
    sensor_kinds = {"lidar2d": RangeScan}

    def __init__(self, params: IrsimParams, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        import irsim  # imported here, because it loads a plotting library that listing plugins does not need

        start, scene = self.context.start, scene_of(self.params)
        scene["world"] |= {"step_time": self.context.period, "sample_time": self.context.period}
        scene["robot"][0]["state"] = [start.x, start.y, start.heading]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.yaml"
            path.write_text(yaml.safe_dump(scene), "utf-8")
            self._simulator = irsim.make(str(path), headless=True, log_level="ERROR")
        self._start, self._time_ns = (start.x, start.y, start.heading), 0

    @classmethod
    def own_world(cls, params: IrsimParams) -> World:
        """The obstacles of the scene, for goal checks, the shortest way and pictures."""
        scene = scene_of(params)
        left, low = scene["world"].get("offset", (0.0, 0.0))
        bounds = (left, low, left + scene["world"]["width"], low + scene["world"]["height"])
        solids = tuple(solid_of(f"obstacle {k}", one) for k, one in enumerate(scene.get("obstacle", ()), 1))
        return World(Path(params.scene).stem, solids, bounds=bounds)

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Advance ir-sim by one step per tick; the first call moves nothing."""
        if given.time_ns > self._time_ns:
            self._simulator.step(np.array([[given.command.vx], [given.command.wz]]))
        self._time_ns = given.time_ns
        robot = self._simulator.robot
        x, y, heading = (float(value) for value in robot.state[:3, 0])
        heading = math.remainder(heading, math.tau)
        twist = Twist2D(float(robot.velocity[0, 0]), 0.0, float(robot.velocity[1, 0]))
        gaps = {
            obstacle.name: float(robot.geometry.distance(obstacle.geometry))
            for obstacle in self._simulator.obstacle_list
        }
        nearest = min(gaps, key=lambda name: gaps[name], default="")
        touching = bool(gaps) and gaps[nearest] <= 0.0
        truth = Truth(Pose2D(x, y, heading), twist, gaps.get(nearest, math.inf), nearest, touching)
        scans = {sensor.name: self._scan(given.time_ns) for sensor in self.context.sensors}
        odometry = Odometry(given.time_ns, seen_from(self._start, (x, y, heading)), twist)
        return PlatformOutput(odometry, scans, Contact(touching), truth)

    def _scan(self, stamp_ns: int) -> RangeScan:
        told, (x, y, turn) = self._simulator.get_lidar_scan(), self._simulator.get_lidar_offset()
        ranges = np.asarray(told["ranges"], dtype=np.float64)
        count, farthest = len(ranges), float(told["range_max"])
        bearings = turn + np.linspace(told["angle_min"], told["angle_max"], count)
        ranges = np.where(ranges < farthest - 1e-3, ranges, np.inf)  # without an echo, ir-sim reports its longest range
        zeros = np.zeros(count)
        return RangeScan(
            stamp_ns,
            np.full((count, 2), (x, y), dtype=np.float64),
            bearings,
            zeros,
            zeros,
            ranges,
            float(told["range_min"]),
            farthest,
        )


def scene_of(params: IrsimParams) -> dict[str, Any]:
    """The scene as in its file. Raises ValueError for a file that cannot be read."""
    path = Path(__file__).parent / params.scene  # an absolute path stays as it is
    try:
        scene = yaml.safe_load(path.read_text("utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise ValueError(f"scene: {path} cannot be read: {error}") from None
    if not isinstance(scene, dict) or not scene.get("robot") or "world" not in scene:
        raise ValueError(f"scene: {path} has no `world` and `robot`, expected a scene of ir-sim")
    return scene


def solid_of(name: str, obstacle: dict[str, Any]) -> Box | Cylinder:
    """The solid of an obstacle in a scene: a circle, or a rectangle rotated by its heading. Raises ValueError."""
    shape, (x, y, *turn) = obstacle["shape"], obstacle["state"]
    if shape["name"] == "circle":
        return Cylinder(name, x, y, shape["radius"])
    if shape["name"] == "rectangle":
        half_x, half_y = 0.5 * shape["length"], 0.5 * shape["width"]
        return Box(name, (x - half_x, x + half_x), (y - half_y, y + half_y), yaw=turn[0] if turn else 0.0)
    raise ValueError(f"{name} is a {shape['name']}, expected a circle or a rectangle")


def seen_from(frame: tuple[float, float, float], pose: tuple[float, float, float]) -> Pose2D:
    """A pose relative to a frame, both given in the map frame, m and rad."""
    x, y, turn = pose[0] - frame[0], pose[1] - frame[1], frame[2]
    cos, sin = math.cos(turn), math.sin(turn)
    return Pose2D(cos * x + sin * y, cos * y - sin * x, math.remainder(pose[2] - turn, math.tau))


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform."""
    registry.add(IrsimRobot)
