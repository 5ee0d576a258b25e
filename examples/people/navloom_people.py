"""People near the robot: a sensor finds their beacons, nodes track them, an avoider slows down, a panel shows them.

The example of docs/beyond-roles.md for own messages, sensors, nodes and panels; people.toml runs it. The node
`people_tracker` that ships with navloom finds people without beacons, in the scans of lasers.
"""

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
    Panel,
    Params,
    PlatformInput,
    PlatformOutput,
    PoseEstimate,
    Publishes,
    RangeScan,
    Registry,
    Seen,
    Sensors,
    Stamp,
    Tick,
    Tracks,
    hookimpl,
    message,
)
from navloom_improved_vfh.adapter import ImprovedVfh
from navloom_sensors_sim.adapter import SensorsSim
from navloom_sensors_sim.params import SensorsSimParams
from numpy.typing import NDArray
from pydantic import Field

Floats = NDArray[np.float64]


@message
class Beacons(Message):
    """Positions of the detected beacons: `points` is (n, 2), m, base frame."""

    stamp_ns: Stamp
    points: Annotated[Floats, Array("float64", ("n", 2))]


def turned(points: Floats, angle: float) -> Floats:
    """(n, 2) points rotated about the origin by an angle, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


class BeaconSettings(Params):
    """Settings of a sensor of kind `beacons`."""

    people: tuple[tuple[float, float], ...] = Field(description="Where they stand, m, map frame.")
    reach: float = Field(5.0, gt=0.0, description="How far a beacon is heard, m.")


class BeaconRobot(SensorsSim):
    """The simulated robot with one more sensor kind."""

    name = "beacon_robot"
    sensor_kinds = {**SensorsSim.sensor_kinds, "beacons": Beacons}
    sensor_settings = {**SensorsSim.sensor_settings, "beacons": BeaconSettings}

    def __init__(self, params: SensorsSimParams, context: Context) -> None:
        super().__init__(params, replace(context, sensors=tuple(s for s in context.sensors if s.kind != "beacons")))
        self.beacons = {s.name: BeaconSettings(**s.settings) for s in context.sensors if s.kind == "beacons"}

    def advance(self, given: PlatformInput) -> PlatformOutput:
        got = super().advance(given)
        assert got.truth is not None
        pose, scans = got.truth.pose, dict(got.scans)
        for name, settings in self.beacons.items():
            points = turned(np.array(settings.people) - (pose.x, pose.y), -pose.heading)
            scans[name] = Beacons(got.odometry.stamp_ns, points[np.hypot(*points.T) < settings.reach])
        return replace(got, scans=scans)


class BeaconTracker(NodePlugin):
    """Transforms the beacons to the map frame: people who stand, each a track with the number of its row."""

    name = "beacon_tracker"
    pose = Latest(PoseEstimate, triggers=True)
    beacons = Sensors(Beacons)
    scans = Sensors(RangeScan)
    tracks = Publishes(Tracks)

    def step(self, tick: Tick) -> None:
        """Publish the tracks for each new pose."""
        assert self.pose.value is not None
        heard = [value.points for news in self.beacons.values() for value in news.values]
        points = self.seen_from(self.pose.value, heard[-1] if heard else np.empty((0, 2)))
        count = len(points)
        still, unsure = np.zeros((count, 2)), np.tile(0.1**2 * np.eye(4), (count, 1, 1))
        self.tracks.put(
            Tracks(tick.time_ns, np.arange(1, count + 1), points, still, unsure, np.full(count, 0.3), np.zeros(count))
        )

    def seen_from(self, estimate: PoseEstimate, points: Floats) -> Floats:
        """(n, 2) points in the map frame, m, from points in the base frame of a robot at this pose."""
        pose = estimate.pose
        return turned(points, pose.heading) + np.array((pose.x, pose.y))


class NearestTracker(BeaconTracker):
    """Tracks the nearest person only."""

    name = "nearest_tracker"

    def seen_from(self, estimate: PoseEstimate, points: Floats) -> Floats:
        return super().seen_from(estimate, points[np.argsort(np.hypot(*points.T))[:1]])


class Polite(ImprovedVfh):
    """The avoider `improved_vfh`, at half the speed near people."""

    name = "polite"
    distance = 1.5  # to a person, m
    tracks = Extra(Tracks)

    def avoid(self, given: AvoiderInput) -> Avoidance:
        answer, pose = super().avoid(given), given.estimate.pose
        gaps = np.hypot(*(given.extra[self.tracks].positions - (pose.x, pose.y)).T)
        share = 0.5 if (gaps < self.distance).any() else 1.0
        return replace(answer, twist=replace(answer.twist, vx=answer.twist.vx * share))


def draw(beacons: Beacons, seen: Seen) -> list[tuple[str, object]]:
    """Draw beacons as spheres of radius 0.1 m, 1 m above the floor."""
    import rerun as rr

    return [(seen.in_base("beacons"), rr.Points3D([(x, y, 1.0) for x, y in beacons.points], radii=0.1))]


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register everything in this file; navloom calls this hook through the entry points."""
    registry.add(BeaconRobot)
    registry.add(Polite)
    registry.node(BeaconTracker)
    registry.node(NearestTracker)
    registry.message(Beacons)
    registry.panel(Panel("beacons", Beacons, draw))
