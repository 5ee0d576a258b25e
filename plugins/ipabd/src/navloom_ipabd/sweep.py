"""A 3D image of a pitched planar laser, checked when it is created."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from navloom_ipabd.errors import SweepError

__all__ = ["Geometry", "SweepImage"]

Floats = NDArray[np.float64]
Geometry = Literal["paper", "rigid_pitch"]


@dataclass(frozen=True, eq=False)
class SweepImage:
    """3D image from one sweep of the pitched laser.

    Attributes:
        ranges: (frames, beams) distance along the beam, m; +inf means no return.
        pitches: (frames,) α, rad, up positive.
        frame_times: (frames,) s after the stamp of the sweep.
        bearings: (beams,) rad in the scan plane, strictly increasing, 0 ahead, counter-clockwise: the paper's β - 90°.
        mount: x, y, z of the sensor in the base frame, m; z above the floor.
        range_min, range_max: Limits of the sensor, m.
        geometry: "paper": eq. (1). "rigid_pitch": a planar laser pitched as a whole.

    Raises:
        SweepError: The image is empty, the shapes are inconsistent, or a number is invalid.
    """

    ranges: Floats
    pitches: Floats
    frame_times: Floats
    bearings: Floats
    mount: tuple[float, float, float]
    range_min: float
    range_max: float
    geometry: Geometry = "paper"

    def __post_init__(self) -> None:
        for name in ("ranges", "pitches", "frame_times", "bearings"):
            object.__setattr__(self, name, _as_floats(f"sweep.{name}", getattr(self, name)))
        object.__setattr__(self, "mount", tuple(float(value) for value in self.mount))
        self._check_shapes()
        self._check_numbers()

    def _check_shapes(self) -> None:
        if self.ranges.ndim != 2 or self.ranges.size == 0:
            raise SweepError("sweep.ranges", f"shape {self.ranges.shape}", "(frames, beams), neither of them 0")
        frames, beams = self.ranges.shape
        for name, size in (("pitches", frames), ("frame_times", frames), ("bearings", beams)):
            shape = getattr(self, name).shape
            if shape != (size,):
                raise SweepError(f"sweep.{name}", f"shape {shape}", f"({size},) to fit ranges {self.ranges.shape}")

    def _check_numbers(self) -> None:
        lowest = np.minimum.reduce(self.ranges, axis=None)  # NaN carries through a minimum
        if not lowest >= 0.0:
            frame, beam = np.argwhere(~(self.ranges >= 0.0))[0]
            value = self.ranges[frame, beam]
            raise SweepError(f"sweep.ranges[{frame}, {beam}]", f"{value:g}", "a distance >= 0 m, or +inf for no return")
        for name in ("pitches", "frame_times", "bearings"):
            values = getattr(self, name)
            if not np.isfinite(values).all():
                index = int(np.argmin(np.isfinite(values)))
                raise SweepError(f"sweep.{name}[{index}]", f"{values[index]:g}", "a finite number")
        if np.abs(self.pitches).max() >= np.pi / 2:
            raise SweepError("sweep.pitches", f"{np.abs(self.pitches).max():g} rad", "pitches within ±π/2")
        if self.bearings.size > 1 and not (np.diff(self.bearings) > 0.0).all():
            raise SweepError("sweep.bearings", "bearings that do not rise", "strictly rising bearings, rad")
        if not 0.0 <= self.range_min < self.range_max:
            raise SweepError("sweep.range_min, range_max", f"{self.range_min:g}, {self.range_max:g}", "0 <= min < max")
        if not np.isfinite(self.mount).all():
            raise SweepError("sweep.mount", f"{self.mount}", "finite x, y, z, m")
        if self.geometry not in ("paper", "rigid_pitch"):
            raise SweepError("sweep.geometry", repr(self.geometry), "'paper' or 'rigid_pitch'")

    @cached_property
    def bearing_step(self) -> float:
        """Mean angle between neighbouring beams, rad; 1° for a single beam."""
        if self.bearings.size == 1:
            return float(np.radians(1.0))
        return float((self.bearings[-1] - self.bearings[0]) / (self.bearings.size - 1))

    @cached_property
    def is_evenly_spaced(self) -> bool:
        """Whether all bearings are within a thousandth of a step of even spacing."""
        even = self.bearings[0] + self.bearing_step * np.arange(self.bearings.size)
        return bool(np.abs(self.bearings - even).max() <= 1e-3 * self.bearing_step)


def _as_floats(place: str, values: object) -> Floats:
    """A read-only contiguous float64 view or copy, the array type that the kernels are compiled for."""
    try:
        array = np.ascontiguousarray(values, dtype=np.float64).view()
    except (TypeError, ValueError):
        raise SweepError(place, type(values).__name__, "an array of numbers") from None
    array.flags.writeable = False
    return array
