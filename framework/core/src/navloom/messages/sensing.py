"""Messages of range sensors, and of what is tracked by them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from navloom.messages.schema import Array, Message, NotNegative, Stamp, message

__all__ = ["RangeScan", "Sweep", "SweepRequest", "Tracks"]

Floats = NDArray[np.float64]


@message()
class RangeScan(Message):
    """Ranges of a planar laser or of a ring of sonars, one entry per beam, in any order.

    The echo of a beam is at `origins + ranges * (cos bearings, sin bearings)`. A reading of `range_max` or more is no
    echo: a platform reports it as +inf, and the platform's node turns other values into +inf before any node reads
    them. Recordings of earlier versions may still hold `range_max` itself, so select the beams with an echo by
    `ranges < range_max`. `navloom.geometry.echoes.scan_points(scan)` does both.

    Attributes:
        stamp_ns: Run clock of the scan.
        origins: (n, 2) origin of each beam, m, base frame.
        bearings: (n,) direction of each beam's axis, rad, base frame.
        half_angles: (n,) half the opening angle of each beam, rad; 0 for a laser.
        time_offsets: (n,) time of each beam, s after the stamp.
        ranges: (n,) distance along the beam, m; +inf, and any reading of range_max or more, means no echo.
        range_min, range_max: Limits of the sensor, m. An object nearer than range_min may read as range_min.
    """

    stamp_ns: Stamp
    origins: Annotated[Floats, Array("float64", ("n", 2))]
    bearings: Annotated[Floats, Array("float64", ("n",))]
    half_angles: Annotated[Floats, Array("float64", ("n",), at_least=0.0)]
    time_offsets: Annotated[Floats, Array("float64", ("n",))]
    ranges: Annotated[Floats, Array("float64", ("n",), infinite=True, at_least=0.0)]
    range_min: NotNegative
    range_max: NotNegative


@message()
class Sweep(Message):
    """One up or down movement of a pitching planar laser: a 3D image.

    With range R, pitch α and bearing b, an echo is, from the sensor forward, left and up, at
    (R cos α cos b, R cos α sin b, R sin α) for `paper`, and at (R cos b cos α, R sin b, R cos b sin α) for
    `rigid_pitch`. `navloom.geometry.echoes.sweep_points(sweep)` gives the points in the base frame,
    `sweep_points_in_map(sweep, track)` the echoes in the map.

    Attributes:
        stamp_ns: Run clock at which the sweep began.
        request_id: Number of the request that it answers; 0 for continuous sweeps.
        ranges: (frames, beams) distance along the beam, m; +inf, and any reading of range_max or more, means no return.
        pitches: (frames,) α, rad, up positive.
        frame_times: (frames,) s after the stamp.
        bearings: (beams,) rad in the scan plane, 0 ahead, counter-clockwise: the paper's β - 90°.
        geometry: "paper" is eq. (1), a pan-tilt model; "rigid_pitch" is a planar laser that is tilted as a whole.
        x, y, z: Sensor in the base frame, m; z above the floor.
        range_min, range_max: Limits of the sensor, m.
    """

    stamp_ns: Stamp
    request_id: int
    ranges: Annotated[Floats, Array("float64", ("frames", "beams"), infinite=True, at_least=0.0)]
    pitches: Annotated[Floats, Array("float64", ("frames",))]
    frame_times: Annotated[Floats, Array("float64", ("frames",))]
    bearings: Annotated[Floats, Array("float64", ("beams",))]
    geometry: Literal["paper", "rigid_pitch"]
    x: float
    y: float
    z: float
    range_min: NotNegative
    range_max: NotNegative


@message()
class SweepRequest(Message):
    """Asks the platform for one stop-and-scan sweep.

    Attributes:
        request_id: Above 0; increases with each request. Live, a request that has led to no map is repeated with the
            same number: a sweep that is already running continues; otherwise a new one starts.
    """

    request_id: int


@message()
class Tracks(Message):
    """People and other bodies that move or may move, each followed from scan to scan, in the order of their ids.

    Attributes:
        stamp_ns: Run clock to which positions and velocities refer.
        ids: (n,) number of each track, above 0; a track keeps it, and no other track of the run has it.
        positions: (n, 2) centre of each body, m, map frame.
        velocities: (n, 2) m/s, map frame.
        covariances: (n, 4, 4) of x, y, vx, vy; m², m²/s, m²/s². The error of the robot's pose, which moves it and all
            bodies alike, is not in them.
        radii: (n,) of the disc that holds the body, m.
        unseen: (n,) time since its last echo, s; 0 for a track that is seen.
    """

    stamp_ns: Stamp
    ids: Annotated[NDArray[np.int64], Array("int64", ("n",))]
    positions: Annotated[Floats, Array("float64", ("n", 2))]
    velocities: Annotated[Floats, Array("float64", ("n", 2))]
    covariances: Annotated[Floats, Array("float64", ("n", 4, 4))]
    radii: Annotated[Floats, Array("float64", ("n",), at_least=0.0)]
    unseen: Annotated[Floats, Array("float64", ("n",), at_least=0.0)]
