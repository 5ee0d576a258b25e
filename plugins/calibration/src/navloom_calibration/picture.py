"""The picture of a calibration: scans of a turn laid over each other, and turn rates, without and with the offset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from navloom_study.report import OKABE_ITO, new_figure, png_of, styled
from numpy.typing import NDArray

from navloom_calibration.laser_track import Beams, Track, Way, velocities_of

__all__ = ["draw"]

Floats = NDArray[np.float64]

BLUE, VERMILION = OKABE_ITO[0], OKABE_ITO[1]
_SPAN = 4.0
"""Length of the turn that is drawn, s."""
_SCANS = 40
"""Most scans that are drawn."""
_SMOOTHING = 0.2
"""Time over which turn rates are averaged, s."""


@styled()
def draw(name: str, scans: Sequence[Beams], way: Way, track: Track, offset: float) -> bytes:
    """The picture as PNG.

    Args:
        name: Of the laser.
        scans: Its scans.
        way: Odometry.
        track: Its motion.
        offset: To be added to its stamps, s.
    """
    figure: Figure
    rates = velocities_of(track, track.stamps - 0.5 * _SMOOTHING, _SMOOTHING)[:, 2]
    begin = _turn(track.stamps, rates)
    figure, axes = new_figure(180.0, 150.0, 2, 2)
    chosen = [scan for scan in scans if begin <= scan.stamp <= begin + _SPAN]
    chosen = chosen[:: max(1, -(-len(chosen) // _SCANS))]
    for column, (shift, words) in enumerate(((0.0, "as stamped"), (offset, f"stamps {offset:+.3f} s"))):
        _overlay(axes[0, column], chosen, way, shift)
        axes[0, column].set_title(f"scans of a turn by odometry, {words}")
        _rates(axes[1, column], track, rates, way, shift, (begin - 0.5 * _SPAN, begin + 1.5 * _SPAN))
        axes[1, column].set_title(f"turn rates, {words}")
    figure.suptitle(name)
    return png_of(figure)


def _turn(stamps: Floats, rates: Floats) -> float:
    """Begin of the time in which the turn rate changes most, s."""
    changes = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(rates)))))
    ends = np.minimum(np.searchsorted(stamps, stamps + _SPAN), len(stamps) - 1)
    return float(stamps[int(np.argmax(changes[ends] - changes))])


def _overlay(axes: Any, scans: Sequence[Beams], way: Way, shift: float) -> None:
    for scan in scans:
        heard = (scan.ranges > scan.range_min) & (scan.ranges < scan.range_max)
        ends = scan.origins[heard] + scan.ranges[heard, None] * np.stack(
            [np.cos(scan.bearings[heard]), np.sin(scan.bearings[heard])], axis=1
        )
        poses = way.at(scan.stamp + shift + scan.time_offsets[heard])
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y = poses[:, 0] + c * ends[:, 0] - s * ends[:, 1], poses[:, 1] + s * ends[:, 0] + c * ends[:, 1]
        axes.plot(x, y, ".", color=BLUE, markersize=1.2, alpha=0.5, markeredgewidth=0.0)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _rates(axes: Any, track: Track, rates: Floats, way: Way, shift: float, span: tuple[float, float]) -> None:
    times = np.arange(*span, 0.02)
    ahead, behind = way.at(times + 0.5 * _SMOOTHING)[:, 2], way.at(times - 0.5 * _SMOOTHING)[:, 2]
    axes.plot(times, (ahead - behind) / _SMOOTHING, color=VERMILION, label="odometry")
    shown = (track.stamps + shift >= span[0]) & (track.stamps + shift <= span[1])
    axes.plot(track.stamps[shown] + shift, rates[shown], color=BLUE, label="scans")
    axes.set_xlabel("time, s")
    axes.set_ylabel("turn rate, rad/s")
    axes.legend()
