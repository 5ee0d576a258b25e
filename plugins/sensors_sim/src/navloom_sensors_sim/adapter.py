"""The simulated robot as a navloom Platform."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from navloom import (
    Contact,
    Context,
    InputError,
    Message,
    Odometry,
    Params,
    Platform,
    PlatformInput,
    PlatformOutput,
    Pose2D,
    RangeScan,
    SensorSpec,
    Sweep,
    Tracks,
    Truth,
    Twist2D,
)

from navloom_sensors_sim.disturbing import Disturbances, Effect
from navloom_sensors_sim.motion import STATE
from navloom_sensors_sim.orders import Orders
from navloom_sensors_sim.params import (
    LaserSettings,
    PitchedLaserSettings,
    SensorsSimParams,
    SonarSettings,
    TrueTracksSettings,
)
from navloom_sensors_sim.robot import Robot
from navloom_sensors_sim.scanners import LaserScanner, LateSensor, Moment, Sensor, SonarRing
from navloom_sensors_sim.scene import Scene
from navloom_sensors_sim.sweeper import PitchedLaser
from navloom_sensors_sim.true_tracks import TrueTracks
from navloom_sensors_sim.warming import warm_up

__all__ = ["SensorsSim"]

_SENSORS: dict[str, tuple[type[Params], Callable[..., Sensor]]] = {
    "pitched_laser": (PitchedLaserSettings, PitchedLaser),
    "laser_2d": (LaserSettings, LaserScanner),
    "sonar_ring": (SonarSettings, SonarRing),
    "true_tracks": (TrueTracksSettings, TrueTracks),
}


HOUSING = 0.02
"""How far the housing of a laser on top of another robot ends above that robot, m: equal robots see each other."""
_FREE, _TOUCHING = Contact(False), Contact(True)


class SensorsSim(Platform[SensorsSimParams]):
    """Drives through the ground truth and reads simulated sensors, odometry and contact.

    A subclass may add sensor kinds; its `advance` then adds their messages to the output of this class.
    """

    name = "sensors_sim"
    sensor_kinds = {"pitched_laser": Sweep, "laser_2d": RangeScan, "sonar_ring": RangeScan, "true_tracks": Tracks}
    true_kinds = frozenset({"true_tracks"})
    sensor_settings = {kind: settings for kind, (settings, _) in _SENSORS.items()}
    is_simulated = True
    takes_disturbances = True

    def __init__(self, params: SensorsSimParams, context: Context) -> None:
        super().__init__(params, context)
        self.reset()

    def reset(self) -> None:
        """Return to the start of the run; the random streams continue."""
        context, spec, start = self.context, self.context.robot, self.context.start
        added = self.sensor_kinds.keys() - _SENSORS.keys()  # the subclass reads these itself
        self._sensors = {sensor.name: self._sensor(sensor) for sensor in context.sensors if sensor.kind not in added}
        solids, raster = (context.world.obstacles, context.world.raster) if context.world is not None else ((), None)
        sweeps = any(sensor.kind == "pitched_laser" for sensor in context.sensors)
        self._scene = Scene(solids, raster, sweeps)
        place = (start.x, start.y, start.heading)
        self._robot = Robot(spec.footprint, spec.height, place, context.stream("odometry"), spec.drive)
        self.configure(self.params)
        self._tick, self._time_ns, self._swept = 0, 0, False
        self._orders = Orders(round(self.params.dead_time * 1e9))
        self._disturbances, self._misplaced = Disturbances(context.disturbances), ""

    def configure(self, params: SensorsSimParams) -> None:
        """Take new parameters; the robot keeps its pose and motion."""
        if params.dead_time != self.params.dead_time:
            self._orders = Orders(round(params.dead_time * 1e9))
        self.params, wheels = params, (self.context.robot.wheel_radius, self.context.robot.half_track)
        drive, robot = params.drive_constants(*wheels), self.context.robot
        if robot.drive == "ackermann":
            steering = params.steering_constants(robot.wheelbase, robot.max_steering, robot.max_steering_rate)
            drive = np.concatenate([drive, steering])
        self._robot.configure(drive, params.odometry_constants(*wheels))

    @classmethod
    def scans_on_request(cls, sensor: SensorSpec) -> bool:
        """The pitched laser, unless it pitches all the time."""
        return sensor.kind == "pitched_laser" and sensor.settings.get("mode") != "continuous"

    def drive(self, command: Twist2D, time_ns: int) -> None:
        """Queue a command for the wheels at its own time within the current tick."""
        self._orders.give(time_ns, *self._asked(command))

    def _asked(self, command: Twist2D) -> tuple[float, ...]:
        """Forward speed, turn rate and, for a holonomic robot, speed to the left."""
        planar = (command.vx, command.wz)
        return (*planar, command.vy) if self.context.robot.drive == "holonomic" else planar

    def advance(self, given: PlatformInput) -> PlatformOutput:
        """Drive with the command until the requested time, then read the sensors that are due."""
        begin_ns = self._time_ns if self._tick else given.time_ns  # the first tick takes no time
        self._time_ns = given.time_ns
        robot, scene, time = self._robot, self._scene, (given.time_ns - begin_ns) / 1e9
        # Before the robot moves: obstacles and robot must be of the same time.
        scene.update(given.time_ns / 1e9, self._swept)
        if given.bodies is not None:
            bodies = given.bodies
            parts = bodies.parts[bodies.parts[:, 0] != given.own_body]  # a copy
            parts[parts[:, 0] >= len(bodies.names) - bodies.robots, 7] += HOUSING
            scene.put(parts, bodies.names)
        legs = self._orders.legs(begin_ns, given.time_ns, self._asked(given.command)) if time > 0.0 else ()
        effect = self._disturbances.act(given.time_ns, robot.pose)
        if effect.pose is not None:
            robot.hold(legs, effect, scene.obstacles)
        elif legs:
            robot.drive_through(legs, scene.obstacles)
        else:
            robot.stand(scene.obstacles)
        if any(effect.slip):
            robot.slip(effect, time)
        self._check_put_down(effect)
        track, asked = robot.track if time > 0.0 else None, given.sweep_request
        request_id = asked.request_id if asked is not None else 0
        moment = Moment(
            self._tick, begin_ns, given.time_ns, robot.state, track, scene.obstacles, scene.opaque, request_id,
            given.bodies, given.own_body,
        )  # fmt: skip
        scans: dict[str, Any] = {}
        for name, (message, sensor) in self._sensors.items():
            fields = sensor.read(moment)
            if fields is not None:
                scans[name] = message(*fields)
        # Some worlds change once the map is made, so that plans meet what no map shows.
        self._swept = self._swept or any(isinstance(scan, Sweep) for scan in scans.values())
        self._tick += 1
        return self._output(scans)

    def _check_put_down(self, effect: Effect) -> None:
        """Refuse a displacement that ends in an obstacle, in each tick from then on: a live robot steps again."""
        state = self._robot.state
        if effect.put_down and state[STATE["touching"]]:
            x, y, heading = self._robot.pose
            self._misplaced = (
                f"{effect.put_down}: at ({x:.2f}, {y:.2f}), {math.degrees(heading):.0f}°, the robot touches "
                f"{self._scene.name_of(int(state[STATE['nearest']]))}; expected a free place"
            )
        if self._misplaced:
            raise InputError(self._misplaced)

    def _output(self, scans: dict[str, Any]) -> PlatformOutput:
        # One call of `tolist` instead of nineteen look-ups.
        x, y, heading, _, _, vx, wz, odo_x, odo_y, odo_heading, odo_vx, odo_wz, _, _, gap, nearest, touching, *more = (
            self._robot.state.tolist()
        )
        _, _, vy, odo_vy, _ = more
        odometry = Odometry(self._time_ns, Pose2D(odo_x, odo_y, odo_heading), Twist2D(odo_vx, odo_vy, odo_wz))
        name, contact = self._scene.name_of(int(nearest)), _TOUCHING if touching != 0.0 else _FREE
        truth = Truth(Pose2D(x, y, heading), Twist2D(vx, vy, wz), gap, name, contact.touching)
        return PlatformOutput(odometry, scans, contact, truth)

    def _sensor(self, spec: SensorSpec) -> tuple[type[Message], Sensor]:
        """Message type and sensor for a sensor's settings.

        Raises:
            InputError: The kind is unknown or a setting is invalid; the message names it.
        """
        if spec.kind not in _SENSORS:
            raise InputError(f"sensor {spec.name}: kind = {spec.kind!r}, expected one of {', '.join(_SENSORS)}")
        settings, make = _SENSORS[spec.kind]
        try:
            checked = settings.model_validate(dict(spec.settings))
            context = self.context
            sensor = make(checked, context.robot.footprint, context.stream(spec.name), context.period)
        except ValueError as error:
            raise InputError(f"sensor {spec.name}: {error}") from error
        if isinstance(checked, (LaserSettings, SonarSettings)) and checked.stamp_delay:
            sensor = LateSensor(sensor, round(1e9 * checked.stamp_delay))
        return self.sensor_kinds[spec.kind], sensor

    @classmethod
    def warm_up(cls) -> None:
        """Compile the kernels, or load them from the cache."""
        warm_up()
