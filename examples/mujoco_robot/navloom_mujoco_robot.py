"""A differential drive in MuJoCo: wheels with contact and friction, motors with lag, ranges by ray casting.

The scene is MuJoCo's own XML, and the config of the robot has no [world]. Odometry counts the turns of the wheels, so
it drifts when they slip.
"""

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
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
    SensorSpec,
    Truth,
    Twist2D,
    World,
    hookimpl,
)
from pydantic import Field

OBSTACLES = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)
"""Flags of the groups of geoms that rays can hit."""
HEIGHT = 0.2
"""Height of the laser above the floor, m."""
MARGIN = 3.0
"""Distance from robot and obstacles to the bounds of a scene with an infinite floor, m."""


class MujocoParams(Params):
    """Parameters of the robot."""

    scene: str = Field("course.xml", description="Scene of MuJoCo: a file beside this module, or an absolute path.")


class RayLaser(Params):
    """Settings of a planar laser, a sensor of kind `ray_laser`."""

    beams: int = Field(181, ge=1, le=2000, description="Number of beams of a scan.")
    field_of_view_deg: float = Field(270.0, gt=0.0, le=360.0, description="Angle from first to last beam, degrees.")
    range_max: float = Field(8.0, gt=0.1, le=100.0, description="Longest range, m; beyond it there is no echo.")


class MujocoRobot(Platform[MujocoParams]):
    """The body `robot` of a scene, with the motors `left motor` and `right motor`."""

    name = "mujoco_robot"
    is_simulated = True
    sensor_kinds = {"ray_laser": RangeScan}
    sensor_settings = {"ray_laser": RayLaser}

    def __init__(self, params: MujocoParams, context: Context) -> None:
        super().__init__(params, context)
        self._model = model_of(params)
        self._settings = {sensor.name: RayLaser(**sensor.settings) for sensor in context.sensors}
        self._body = self._model.body("robot").id
        self.reset()

    def reset(self) -> None:
        start = self.context.start
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:2] = start.x, start.y
        self._data.qpos[3:7] = math.cos(0.5 * start.heading), 0.0, 0.0, math.sin(0.5 * start.heading)
        mujoco.mj_forward(self._model, self._data)
        self._wheels = self._turned()
        self._reckoned, self._time_ns = (0.0, 0.0, 0.0), 0

    @classmethod
    def own_world(cls, params: MujocoParams) -> World:
        """The obstacles of the scene, for goal checks, the shortest way and pictures."""
        model = model_of(params)
        solids = tuple(solid_of(model, geom) for geom in obstacles_of(model))
        return World(Path(params.scene).stem, solids, bounds=bounds_of(model))

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Advance MuJoCo by as many steps as fit into the tick; the first call moves nothing."""
        seconds = (given.time_ns - self._time_ns) * 1e-9
        self._time_ns = given.time_ns
        robot, command = self.context.robot, given.command
        for side, motor in ((-1.0, "left motor"), (1.0, "right motor")):
            self._data.actuator(motor).ctrl = (command.vx + side * robot.half_track * command.wz) / robot.wheel_radius
        for _ in range(round(seconds / self._model.opt.timestep)):
            mujoco.mj_step(self._model, self._data)
        twist = self._reckon(seconds)
        odometry = Odometry(given.time_ns, Pose2D(*self._reckoned), twist)
        scans = {sensor.name: self._scan(sensor, given.time_ns) for sensor in self.context.sensors}
        truth = self._truth()
        return PlatformOutput(odometry, scans, Contact(truth.touching), truth)

    def _turned(self) -> tuple[float, float]:
        """Angles of the left and the right wheel, rad."""
        left, right = (float(self._data.joint(side).qpos[0]) for side in ("left", "right"))
        return left, right

    def _reckon(self, seconds: float) -> Twist2D:
        """Add the turns of the wheels since the last tick to the odometry; returns the corresponding velocity."""
        robot, before, now = self.context.robot, self._wheels, self._turned()
        self._wheels = now
        left, right = (robot.wheel_radius * (after - first) for first, after in zip(before, now, strict=True))
        way, turn = 0.5 * (left + right), 0.5 * (right - left) / robot.half_track
        x, y, heading = self._reckoned
        middle = heading + 0.5 * turn
        x, y = x + way * math.cos(middle), y + way * math.sin(middle)
        self._reckoned = (x, y, math.remainder(heading + turn, math.tau))
        return Twist2D(way / seconds, 0.0, turn / seconds) if seconds else Twist2D(0.0, 0.0, 0.0)

    def _pose(self) -> tuple[float, float, float]:
        x, y, _ = self._data.xpos[self._body]
        turn = self._data.xmat[self._body].reshape(3, 3)
        return float(x), float(y), math.atan2(turn[1, 0], turn[0, 0])

    def _truth(self) -> Truth:
        x, y, heading = self._pose()
        vx, vy = self._data.qvel[:2]
        cos, sin = math.cos(heading), math.sin(heading)
        twist = Twist2D(float(cos * vx + sin * vy), float(cos * vy - sin * vx), float(self._data.qvel[5]))
        gap, nearest = self._gap()
        return Truth(Pose2D(x, y, heading), twist, gap, nearest, gap <= 0.0)

    def _gap(self) -> tuple[float, str]:
        """Distance from chassis and wheels to the nearest obstacle, m, and its name."""
        best, nearest, ends = math.inf, "", np.zeros(6)
        own = [geom for geom in range(self._model.ngeom) if self._model.geom_group[geom] == 1]
        for geom in obstacles_of(self._model):
            for part in own:
                gap = mujoco.mj_geomDistance(self._model, self._data, part, geom, 5.0, ends)
                if gap < best:
                    best, nearest = float(gap), self._model.geom(geom).name
        return max(0.0, best), nearest

    def _scan(self, sensor: SensorSpec, stamp_ns: int) -> RangeScan:
        settings, (x, y, heading) = self._settings[sensor.name], self._pose()
        bearings = math.radians(settings.field_of_view_deg) * np.linspace(-0.5, 0.5, settings.beams)
        origin, hit = np.array([x, y, HEIGHT]), np.zeros(1, dtype=np.int32)
        ranges = np.empty(settings.beams)
        for beam, angle in enumerate(heading + bearings):
            way = np.array([math.cos(angle), math.sin(angle), 0.0])
            ranges[beam] = mujoco.mj_ray(self._model, self._data, origin, way, OBSTACLES, True, -1, hit)
        ranges = np.where((ranges < 0.0) | (ranges >= settings.range_max), np.inf, ranges)
        zeros = np.zeros(settings.beams)
        return RangeScan(
            stamp_ns, np.zeros((settings.beams, 2)), bearings, zeros, zeros, ranges, 0.05, settings.range_max
        )  # fmt: skip


def model_of(params: MujocoParams) -> Any:
    """The compiled scene. Raises ValueError for a file that cannot be used."""
    path = Path(__file__).parent / params.scene  # an absolute path stays as it is
    try:
        return mujoco.MjModel.from_xml_string(path.read_text("utf-8"))
    except OSError as error:
        raise ValueError(f"scene: {path}: {error.strerror}") from None


def obstacles_of(model: Any) -> list[int]:
    """Geoms of a scene that are neither part of the robot nor the floor."""
    is_floor = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    return [int(geom) for geom in np.flatnonzero((model.geom_group == 0) & ~is_floor)]


def bounds_of(model: Any) -> tuple[float, float, float, float]:
    """Lowest x, lowest y, highest x and highest y of a scene, m: of its floor, or round the obstacles and the robot."""
    finite = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_size[:, :2] > 0.0).all(1))
    if len(finite):
        centres, halves = model.geom_pos[finite, :2], model.geom_size[finite, :2]
    else:
        solid = obstacles_of(model)
        centres = np.vstack([model.geom_pos[solid, :2], model.body("robot").pos[:2]])
        halves = MARGIN + np.append(model.geom_rbound[solid], 0.0)[:, None]
    low, high = (centres - halves).min(axis=0), (centres + halves).max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def solid_of(model: Any, geom: int) -> Box | Cylinder:
    """The solid of a geom: an upright cylinder or box. Raises ValueError for any other geom."""
    name, (x, y, z), size = model.geom(geom).name, model.geom_pos[geom], model.geom_size[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return Cylinder(name, float(x), float(y), float(size[0]), (float(z - size[1]), float(z + size[1])))
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        w, _, _, up = model.geom_quat[geom]
        spans = [(float(at - half), float(at + half)) for at, half in zip((x, y, z), size, strict=True)]
        return Box(name, spans[0], spans[1], spans[2], yaw=2.0 * math.atan2(up, w))
    raise ValueError(f"scene: geom {name!r} is neither a box nor a cylinder")


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Add the platform."""
    registry.add(MujocoRobot)
