"""The pitched laser as a sensor: when its sweeps begin and end, their noise, and what they report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from navloom_sensors_sim.beams import fan
from navloom_sensors_sim.scanners import Fields, Floats, Moment, freeze
from navloom_sensors_sim.sweeping import frame_offsets_ns, read_frames, sweep_directions

if TYPE_CHECKING:
    from navloom_sensors_sim.params import PitchedLaserSettings

__all__ = ["PitchedLaser"]


class PitchedLaser:
    """A pitching laser that sweeps on request, or continuously with alternating direction.

    Each tick draws exactly one random number. The number of the tick in which a sweep begins seeds the noise of that
    sweep, so neither the scene nor a request can change the noise of later sweeps.
    """

    def __init__(self, s: PitchedLaserSettings, footprint: Floats, rng: np.random.Generator, period: float) -> None:
        if s.sweep_time < period:
            raise ValueError(f"sweep_time = {s.sweep_time:g} s, expected at least one tick, {period:g} s")
        pitches = np.radians(s.first_pitch_deg + s.pitch_step_deg * np.arange(s.frames, dtype=np.float64))
        bearings = fan(s.beams, math.radians(s.field_of_view_deg), 0.0)
        self._draw, self._settings, self._bearings = rng.bit_generator.random_raw, s, freeze(bearings)
        bias = rng.uniform(-s.systematic, s.systematic)
        errors = (s.sigma, bias) if s.noise else (0.0, 0.0)
        self._options, self._mount = np.array([s.range_min, s.range_max, *errors]), np.array([s.x, s.y, s.z])
        ways = sweep_directions(pitches, bearings, s.geometry)
        self._ways = (ways, np.ascontiguousarray(ways[::-1]))
        self._pitches = (freeze(pitches), freeze(pitches[::-1]))
        self._offsets, self._length = frame_offsets_ns(s.frames, s.sweep_time), round(s.sweep_time * 1e9)
        self._times = freeze(self._offsets / 1e9)
        self._asked, self._answers, self._begin, self._taken, self._down = 0, 0, -1, 0, 0
        self._ranges = self._normals = np.empty((0, 0))

    def read(self, moment: Moment) -> Fields | None:
        """The sweep that ended in this tick, if one did."""
        seed = self._draw()
        if self._begin < 0 or moment.request_id != self._answers:  # else the request repeats the current sweep's
            self._asked = moment.request_id or self._asked
        continuous = self._settings.mode == "continuous"
        if moment.track is None:
            return None
        if self._begin < 0 if continuous else self._asked > 0:
            self._start(moment.begin_ns, seed, down=0)
        if self._begin < 0:
            return None
        self._take(moment)
        end = self._begin + self._length
        if moment.end_ns < end:
            return None
        sweep = self._fields()
        self._begin = -1
        if continuous:
            self._start(end, seed, down=1 - self._down)
            self._take(moment)
        return sweep

    def _start(self, begin_ns: int, seed: int, down: int) -> None:
        """Begin a sweep that answers the last request; a sweep in progress is discarded."""
        shape = (self._settings.frames, self._settings.beams)
        self._normals = np.random.Generator(np.random.PCG64(seed)).standard_normal(shape)
        self._ranges, self._begin, self._taken, self._down = np.empty(shape), begin_ns, 0, down
        self._answers, self._asked = self._asked, 0

    def _take(self, moment: Moment) -> None:
        """Measure the frames whose time lies in the tick, its end excluded."""
        first, last = self._taken, int(np.searchsorted(self._offsets, moment.end_ns - self._begin))
        if last > first:
            times = (self._offsets[first:last] + (self._begin - moment.begin_ns)) / 1e9
            span = slice(first, last)
            read_frames(
                moment.track, times, self._mount, self._ways[self._down][span], moment.opaque, self._options,
                self._normals[span], self._ranges[span],
            )  # fmt: skip
        self._taken = last

    def _fields(self) -> Fields:
        s = self._settings
        return (
            self._begin, self._answers, freeze(self._ranges), self._pitches[self._down], self._times, self._bearings,
            s.geometry, s.x, s.y, s.z, s.range_min, s.range_max,
        )  # fmt: skip
