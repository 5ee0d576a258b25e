"""The planar laser and the ring of sonars as objects: when they are due, their random draws, and what they report."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from navloom_sensors_sim.beams import cone_rays, fan, fan_step, read_cones, read_laser, ring_mounts
from navloom_sensors_sim.casting import Obstacles

if TYPE_CHECKING:
    from navloom_sensors_sim.params import LaserSettings, SonarSettings

__all__ = ["LaserScanner", "LateSensor", "Moment", "Sensor", "SonarRing", "freeze"]

Floats = NDArray[np.float64]
Fields = tuple[Any, ...]
"""Fields of the message of a sensor, RangeScan or Sweep, in their order."""


class Moment(NamedTuple):
    """The tick that has just been simulated.

    Attributes:
        tick: Its number from 0.
        begin_ns, end_ns: Run clock at its beginning and its end.
        state: (22,) of `motion.STATE` at its end.
        track: (n, 6) the true motion within it, see `motion.drive_tick`; None if no time passed.
        obstacles: What can be hit at its end.
        opaque: The same without glass: what lasers see.
        request_id: Of a sweep that was requested at its beginning, else 0.
    """

    tick: int
    begin_ns: int
    end_ns: int
    state: Floats
    track: Floats | None
    obstacles: Obstacles
    opaque: Obstacles
    request_id: int


class Sensor(Protocol):
    """A sensor."""

    def read(self, moment: Moment) -> Fields | None:
        """Message fields completed in the tick, or None; what the sensor sees never changes how much it draws."""


class LateSensor:
    """A sensor whose messages arrive a time after the measurement, ns, and bear the stamp of their arrival."""

    def __init__(self, sensor: Sensor, delay_ns: int) -> None:
        self._sensor, self._delay_ns = sensor, delay_ns
        self._underway: deque[Fields] = deque()

    def read(self, moment: Moment) -> Fields | None:
        """The message that arrived in the tick, if one did; the sensor gives at most one a tick."""
        fields = self._sensor.read(moment)
        if fields is not None:
            self._underway.append((fields[0] + self._delay_ns, *fields[1:]))
        return self._underway.popleft() if self._underway and self._underway[0][0] <= moment.end_ns else None


def _ticks_between(rate_hz: float | None, period: float) -> int:
    """Ticks from one reading to the next.

    Raises:
        ValueError: The rate does not divide the tick rate.
    """
    if rate_hz is None:
        return 1
    every = 1.0 / (rate_hz * period)
    if round(every) < 1 or abs(every - round(every)) > 1e-6:
        raise ValueError(f"rate_hz = {rate_hz:g}, expected the tick rate, {1.0 / period:g}, or an integer part of it")
    return round(every)


def freeze(array: Floats) -> Floats:
    """Make an array read-only and contiguous, so that messages share it instead of copying it."""
    if not array.flags.c_contiguous:
        array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def _drop(ranges: Floats, share: float, rng: np.random.Generator) -> None:
    """Remove the echo of each beam with probability `share`; draws nothing if that is 0."""
    if share > 0.0:
        ranges[rng.random(len(ranges)) < share] = math.inf


class LaserScanner:
    """A planar laser; all beams are measured at once, at the end of the tick."""

    def __init__(self, s: LaserSettings, footprint: Floats, rng: np.random.Generator, period: float) -> None:
        field_of_view = math.radians(s.field_of_view_deg)
        bearings = fan(s.beams, field_of_view, math.radians(s.heading_deg))
        count = len(bearings)
        self._rng, self._every, self._settings = rng, _ticks_between(s.rate_hz, period), s
        self._origins = np.repeat([[s.x], [s.y], [s.z]], count, axis=1)
        self._directions = np.stack([np.cos(bearings), np.sin(bearings), np.zeros(count)])
        spread = (bearings[0], fan_step(s.beams, field_of_view))
        self._options = np.array([s.range_min, s.range_max, s.sigma if s.noise else 0.0, *spread])
        self._bearings, self._zeros = freeze(bearings), freeze(np.zeros(count))
        self._places = freeze(self._origins[:2].T)

    def read(self, moment: Moment) -> Fields | None:
        """The scan at the end of the tick, if one is due."""
        if moment.tick % self._every:
            return None
        count, s = len(self._zeros), self._settings
        normals, ranges = self._rng.standard_normal(count), np.empty(count)
        rays = (self._origins, self._directions)
        read_laser(moment.state, *rays, moment.opaque, self._options, normals, ranges)
        if s.noise:
            _drop(ranges, s.dropout, self._rng)
            if s.stuck_beam is not None:
                ranges[s.stuck_beam] = s.stuck_range
        beams = (self._places, self._bearings, self._zeros, self._zeros)
        return moment.end_ns, *beams, freeze(ranges), s.range_min, s.range_max


class SonarRing:
    """A ring of cone sonars, all fired at once, at the end of the tick."""

    def __init__(self, s: SonarSettings, footprint: Floats, rng: np.random.Generator, period: float) -> None:
        places, bearings, self._closed = ring_mounts(s.layout, footprint)
        half = math.radians(s.half_angle_deg)
        self._rng, self._every, self._settings = rng, _ticks_between(s.rate_hz, period), s
        self._origins, self._directions = cone_rays(places, bearings, s.z, half, s.columns, s.rows)
        critical = -1.0 if s.critical_angle_deg is None else math.cos(math.radians(s.critical_angle_deg))
        sigma, crosstalk = (s.sigma, s.crosstalk) if s.noise else (0.0, 0.0)
        self._options = np.array([s.range_min, s.range_max, sigma, critical, crosstalk, float(s.floor_echoes)])
        self._places, self._bearings = freeze(places), freeze(bearings)
        self._halves, self._zeros = freeze(np.full(len(places), half)), freeze(np.zeros(len(places)))

    def read(self, moment: Moment) -> Fields | None:
        """The readings at the end of the tick, if they are due."""
        if moment.tick % self._every:
            return None
        count, s = len(self._zeros), self._settings
        draws, ranges = (self._rng.standard_normal(count), self._rng.random((count, 3))), np.empty(count)
        rays = (self._origins, self._directions)
        read_cones(moment.state, *rays, moment.obstacles, self._options, self._closed, *draws, ranges)
        if s.noise:
            _drop(ranges, s.dropout, self._rng)
        beams = (self._places, self._bearings, self._halves, self._zeros)
        return moment.end_ns, *beams, freeze(ranges), s.range_min, s.range_max
