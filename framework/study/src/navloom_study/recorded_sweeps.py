"""Recorded sweeps of pitched lasers, and the map that a mapper makes of one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter_ns
from typing import Any

import numpy as np
from navloom.config import ConfigError, check_params
from navloom.config.config_presets import preset_values
from navloom.config.loader import parse_override
from navloom.config.tables import DEFAULT_PLUGINS, RobotTable, RunTable
from navloom.engine.build import robot_spec
from navloom.engine.random_streams import stream_source
from navloom.inputs.npz import Arrays
from navloom.messages import MapUpdate, MessageError, Pose2D, PoseTrack, Sweep
from navloom.plugins import Discovery
from navloom.roles import Context, Mapper, MapperInput
from navloom.roles.presets import named_plugin
from navloom.runs.single_plan import blamed
from numpy.typing import NDArray

__all__ = ["MappedSweep", "SweepRecording", "find_floor", "map_sweep", "read_recording", "sweep_of"]

Floats = NDArray[np.float64]
ARRAYS = ("ranges_m", "pitch_deg", "beam_deg")
"""Arrays of a recorded sweep."""
FRAME_TIME = 0.0133
"""Time between frames, s: 75 frames a second; files do not contain it."""
SMALLEST = 0.3
"""Shortest range that is used to find the floor, m."""


@dataclass(frozen=True, eq=False)
class SweepRecording:
    """A recorded sweep.

    Attributes:
        ranges: (frames, beams) m.
        pitches: (frames,) rad, up positive.
        bearings: (beams,) rad, increasing, counter-clockwise in the scan plane.
        range_max: Largest range that the scanner reports, m; it means no return.
    """

    ranges: Floats
    pitches: Floats
    bearings: Floats
    range_max: float


@dataclass(frozen=True, eq=False)
class MappedSweep:
    """A sweep with its map and the computing time of the mapper, ms."""

    sweep: Sweep
    update: MapUpdate
    mapper_ms: float

    def counts(self) -> dict[str, int]:
        """Number of points by use; the sum is the number of points in the sweep."""
        return {count.name: count.value for count in self.update.counts}


def read_recording(path: Path) -> SweepRecording:
    """Read an .npz with `ranges_m` (frames, beams), `pitch_deg` (frames,) and `beam_deg` (beams,), right positive.

    Raises:
        ConfigError: The file is missing or damaged, or its arrays do not match.
    """
    try:
        found = Arrays(path, ConfigError)
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such file") from None
    missing = [name for name in ARRAYS if name not in found.names]
    if missing:
        raise ConfigError(f"{path}: array {missing[0]!r} is missing; expected ranges_m, pitch_deg and beam_deg")
    ranges, pitches, beams = (found.read(name).astype(np.float64) for name in ARRAYS)
    if ranges.ndim != 2 or ranges.shape != (*pitches.shape, *beams.shape) or not ranges.size:
        raise ConfigError(
            f"{path}: ranges_m is {ranges.shape}, pitch_deg {pitches.shape}, beam_deg {beams.shape}; "
            "expected (frames, beams), (frames,) and (beams,), with at least one frame and one beam"
        )
    _refuse_bad_numbers(path, "ranges_m", ranges, ranges >= 0.0, "ranges >= 0 m, or inf for no return")
    _refuse_bad_numbers(path, "pitch_deg", pitches, np.isfinite(pitches), "finite angles")
    _refuse_bad_numbers(path, "beam_deg", beams, np.isfinite(beams), "finite angles")
    returned = ranges[np.isfinite(ranges)]
    if not returned.size:
        raise ConfigError(f"{path}: ranges_m holds nothing but inf, expected a range in m where a beam met something")
    bearings = -np.radians(beams)
    order = np.argsort(bearings)
    return SweepRecording(ranges[:, order], np.radians(pitches), bearings[order], float(returned.max()))


def _refuse_bad_numbers(path: Path, name: str, values: Floats, good: NDArray[np.bool_], wanted: str) -> None:
    bad = np.argwhere(~good)
    if len(bad):
        place = tuple(int(number) for number in bad[0])
        raise ConfigError(f"{path}: {name}{list(place)} is {values[place]:g}, expected {wanted}")


def find_floor(recording: SweepRecording) -> tuple[float, float]:
    """Zero offset of the pitch and height of the sensor, estimated from the floor.

    In rings of 0.25 m ahead, the most frequent height below the sensor is that of the floor. A line through these
    heights gives the height under the sensor, and its slope the zero offset of the pitch.

    Returns:
        Offset to add to the pitches, rad, and height of the sensor above the floor, m.

    Raises:
        ConfigError: The floor is seen in fewer than three rings.
    """
    alpha, beta = recording.pitches[:, None], recording.bearings[None, :]
    forward = recording.ranges * np.cos(beta)
    x, y, z = forward * np.cos(alpha), recording.ranges * np.sin(beta) + 0.0 * alpha, forward * np.sin(alpha)
    usable = (recording.ranges > SMALLEST) & (recording.ranges < recording.range_max) & (np.abs(y) < 0.8)
    rings, heights = [], []
    for ring in np.arange(0.25, 3.5, 0.25):
        inside = usable & (x >= ring) & (x < ring + 0.25)
        numbers, edges = np.histogram(z[inside], bins=np.arange(-1.5, -0.2, 0.01))
        if numbers.max() >= 10:
            rings.append(ring + 0.125)
            heights.append(edges[numbers.argmax()] + 0.005)
    if len(rings) < 3:
        raise ConfigError("no floor is seen near the sensor; give --pitch-offset and --height")
    slope, under = np.polyfit(rings, heights, 1)
    return math.atan(-slope), -float(under)


def sweep_of(recording: SweepRecording, pitch_offset: float, height: float) -> Sweep:
    """The message for a mapper: a planar laser that pitches as a whole, `height` m above the floor."""
    frames = len(recording.pitches)
    try:
        return Sweep(
            0,
            1,
            recording.ranges,
            recording.pitches + pitch_offset,
            np.arange(frames, dtype=np.float64) * FRAME_TIME,
            recording.bearings,
            "rigid_pitch",
            0.0,
            0.0,
            height,
            SMALLEST,
            recording.range_max,
        )
    except MessageError as error:
        raise ConfigError(str(error)) from None


def map_sweep(
    sweep: Sweep,
    *,
    mapper: str = DEFAULT_PLUGINS["mapper"],
    changes: Sequence[str] = (),
    discovery: Discovery | None = None,
) -> MappedSweep:
    """Map one sweep, taken at standstill at the origin, with a mapper plugin.

    Args:
        sweep: The sweep.
        mapper: Name of the plugin.
        changes: Its parameters as `key=value`.

    Raises:
        ConfigError, PluginError: The request is wrong, or the mapper fails; InputError: it cannot use the sweep.
    """
    name, preset = named_plugin(mapper)
    cls = (discovery or Discovery()).role("mapper", name)
    assert issubclass(cls, Mapper)
    params: Any = check_params(
        cls.Params,
        {**preset_values(cls, preset, f"--mapper {mapper}"), **dict(map(parse_override, changes))},
        "--set",
    )
    context = Context(
        "map", RunTable().period, robot_spec(RobotTable()), stream_source(0, "mapper", "map"), Pose2D(0.0, 0.0, 0.0)
    )
    end_ns = round(float(sweep.frame_times.max()) * 1e9)
    track = PoseTrack(np.array([0, end_ns + 1]), np.zeros((2, 3)))
    with blamed(cls):
        cls.warm_up()
        plugin = cls(params, context)
        before = perf_counter_ns()
        update = plugin.update(MapperInput(end_ns, (sweep,), (), track))
        spent = (perf_counter_ns() - before) * 1e-6
    if update is None:
        raise ConfigError(f"mapper {mapper} makes no map of a sweep")
    return MappedSweep(sweep, update, spent)
