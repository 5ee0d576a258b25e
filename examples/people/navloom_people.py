"""People near the robot: a sensor finds their beacons, nodes track them, an avoider slows down, a panel shows them.

The example of docs/beyond-roles.md for own messages, sensors, nodes and panels; people.toml runs it.
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


@message
class Tracks(Message):
    """Positions of people: `points` is (n, 2), m, map frame; `echoes` is the number of beams with an echo."""

    stamp_ns: Stamp
    points: Annotated[Floats, Array("float64", ("n", 2))]
    echoes: int


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


class PeopleTracker(NodePlugin):
    """Transforms the beacons to the map frame."""

    name = "people_tracker"
    pose = Latest(PoseEstimate, triggers=True)
    beacons = Sensors(Beacons)
    scans = Sensors(RangeScan)
    tracks = Publishes(Tracks)

    def step(self, tick: Tick) -> None:
        """Publish the tracks for each new pose."""
        assert self.pose.value is not None
        heard = [value.points for news in self.beacons.values() for value in news.values]
        echoes = sum(int(np.isfinite(scan.ranges).sum()) for news in self.scans.values() for scan in news.values)
        points = self.seen_from(self.pose.value, heard[-1] if heard else np.empty((0, 2)))
        self.tracks.put(Tracks(tick.time_ns, points, echoes))

    def seen_from(self, estimate: PoseEstimate, points: Floats) -> Floats:
        """(n, 2) points in the map frame, m, from points in the base frame of a robot at this pose."""
        pose = estimate.pose
        return turned(points, pose.heading) + np.array((pose.x, pose.y))


class NearestTracker(PeopleTracker):
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
        gaps = np.hypot(*(given.extra[self.tracks].points - (pose.x, pose.y)).T)
        share = 0.5 if (gaps < self.distance).any() else 1.0
        return replace(answer, twist=replace(answer.twist, vx=answer.twist.vx * share))


def draw(tracks: Tracks, seen: Seen) -> list[tuple[str, object]]:
    """Draw people as spheres of radius 0.3 m, 1 m above the floor."""
    import rerun as rr

    return [(seen.in_map("people"), rr.Points3D([(x, y, 1.0) for x, y in tracks.points], radii=0.3))]


@hookimpl
def navloom_register(registry: Registry) -> None:
    """Register everything in this file; navloom calls this hook through the entry points."""
    registry.add(BeaconRobot)
    registry.add(Polite)
    registry.node(PeopleTracker)
    registry.node(NearestTracker)
    registry.message(Beacons)
    registry.message(Tracks)
    registry.panel(Panel("people", Tracks, draw))
