"""People near the robot: a sensor that hears their beacons, nodes that track them, and an avoider that minds them."""

import math
from dataclasses import replace
from typing import Annotated

import numpy as np
from navloom import (
    Array,
    Avoidance,
    AvoiderInput,
    Context,
    Extra,
    Latest,
    Message,
    NodePlugin,
    Params,
    PlatformInput,
    PlatformOutput,
    PoseEstimate,
    Publishes,
    RangeScan,
    Registry,
    Sensors,
    Stamp,
    Tick,
    Twist2D,
    hookimpl,
    message,
)
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_improved_vfh.params import ImprovedVfhParams
from navloom_sensors_sim.adapter import SensorsSim
from navloom_sensors_sim.params import SensorsSimParams
from numpy.typing import NDArray
from pydantic import Field

Floats = NDArray[np.float64]


@message
class Beacons(Message):
    """Directions of the beacons that are heard: `points` is (n, 2), m, base frame."""

    stamp_ns: Stamp
    points: Annotated[Floats, Array("float64", ("n", 2))]


@message
class Tracks(Message):
    """Where people are: `points` is (n, 2), m, map frame; `echoes` counts the beams that heard anything."""

    stamp_ns: Stamp
    points: Annotated[Floats, Array("float64", ("n", 2))]
    echoes: int


class BeaconSettings(Params):
    people: tuple[tuple[float, float], ...] = Field(description="Where they stand, m, map frame.")
    reach: float = Field(5.0, gt=0.0, description="How far a beacon is heard, m.")


class BeaconRobot(SensorsSim):
    """The simulated robot with one more kind of sensor."""

    name = "beacon_robot"
    sensor_kinds = {**SensorsSim.sensor_kinds, "beacons": Beacons}
    sensor_settings = {**SensorsSim.sensor_settings, "beacons": BeaconSettings}

    def __init__(self, params: SensorsSimParams, context: Context) -> None:
        self.inner = SensorsSim(params, replace(context, sensors=[s for s in context.sensors if s.kind != "beacons"]))
        self.params, self.context = params, context
        self.beacons = {s.name: BeaconSettings(**s.settings) for s in context.sensors if s.kind == "beacons"}

    def drive(self, command: Twist2D, time_ns: int) -> None:
        self.inner.drive(command, time_ns)

    def advance(self, given: PlatformInput) -> PlatformOutput:
        got = self.inner.advance(given)
        assert got.truth is not None
        pose = got.truth.pose
        turn = np.array(
            [[math.cos(pose.heading), -math.sin(pose.heading)], [math.sin(pose.heading), math.cos(pose.heading)]]
        )
        scans = dict(got.scans)
        for name, settings in self.beacons.items():
            points = (np.array(settings.people) - (pose.x, pose.y)) @ turn
            scans[name] = Beacons(got.odometry.stamp_ns, points[np.hypot(*points.T) < settings.reach])
        return replace(got, scans=scans)


class PeopleTracker(NodePlugin):
    """Puts the beacons into the map."""

    name = "people_tracker"
    pose = Latest(PoseEstimate, triggers=True)
    beacons = Sensors(Beacons)
    scans = Sensors(RangeScan)
    tracks = Publishes(Tracks)

    def step(self, tick: Tick) -> None:
        assert self.pose.value is not None
        heard = [beacons for news in self.beacons.values() for beacons in news.values]
        echoes = sum(int(np.isfinite(scan.ranges).sum()) for news in self.scans.values() for scan in news.values)
        points = self.seen_from(self.pose.value, heard[-1].points if heard else np.empty((0, 2)))
        self.tracks.put(Tracks(tick.time_ns, points, echoes))

    def seen_from(self, estimate: PoseEstimate, points: Floats) -> Floats:
        pose = estimate.pose
        c, s = math.cos(pose.heading), math.sin(pose.heading)
        return points @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)


class NearestTracker(PeopleTracker):
    """Tracks the nearest person only."""

    name = "nearest_tracker"

    def seen_from(self, estimate: PoseEstimate, points: Floats) -> Floats:
        nearest = points[np.argsort(np.hypot(*points.T))[:1]]
        return super().seen_from(estimate, nearest)


class PoliteParams(ImprovedVfhParams):
    distance: float = Field(1.5, gt=0.0, description="Nearer than this to a person it slows down, m.")


class Polite(ImprovedVfh):
    """Improved VFH, slower beside people."""

    name = "polite"
    Params = PoliteParams
    params: PoliteParams
    tracks = Extra(Tracks)

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer, pose = super().avoid(given), given.estimate.pose
        gaps = np.hypot(*(given.extra[self.tracks].points - (pose.x, pose.y)).T)
        share = 0.5 if (gaps < self.params.distance).any() else 1.0
        return replace(answer, twist=Twist2D(answer.twist.vx * share, 0.0, answer.twist.wz))


@hookimpl
def navloom_register(registry: Registry) -> None:
    for cls in (BeaconRobot, Polite):
        registry.add(cls)
    for node in (PeopleTracker, NearestTracker):
        registry.node(node)
    for kind in (Beacons, Tracks):
        registry.message(kind)
