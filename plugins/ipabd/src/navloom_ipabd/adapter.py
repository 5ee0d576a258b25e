"""IPaBD, and its first step alone, as navloom mappers."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping
from typing import TypeVar

from navloom import (
    Claim,
    Context,
    Count,
    Derived,
    InputError,
    Mapper,
    MapperInput,
    MapUpdate,
    OccupancyGrid,
    Pose2D,
    RobotSpec,
    Sweep,
)

from navloom_ipabd import mapping
from navloom_ipabd.errors import DataError
from navloom_ipabd.mapping import GridMap, Outline
from navloom_ipabd.params import PRINTED, ROBUST, IpabdParams, UnionParams
from navloom_ipabd.rules import Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import FrameMotion, frame_motion
from navloom_ipabd.union import union_outline

__all__ = ["Ipabd", "Union"]


P = TypeVar("P", bound=IpabdParams | UnionParams)


class _OfSweeps(Mapper[P]):
    """Base of the mappers that merge the outlines of sweeps into one map. Subclasses define the outline."""

    accepts = (Sweep,)

    def __init__(self, params: P, context: Context) -> None:
        super().__init__(params, context)
        self._settings = params.settings(context.robot.height, (context.start.x, context.start.y))
        self._known: GridMap | None = None
        self._is_doubted = False

    def reset(self) -> None:
        self._known, self._is_doubted = None, False

    @classmethod
    def warm_up(cls) -> None:
        mapping.warm_up()

    def update(self, given: MapperInput) -> MapUpdate | None:
        self._is_doubted |= given.clear
        if not given.sweeps:
            return None
        try:
            return self._updated(given)
        except DataError as error:
            raise InputError(f"ipabd: {error}") from error

    def _updated(self, given: MapperInput) -> MapUpdate:
        known, stamp_ns, counts = self._known, given.stamp_ns, Counter[Rule]()
        tolerance = self._settings.line_tolerance
        for sweep in given.sweeps:
            shown = self._outline(sweep, given)
            new = mapping.draw(shown, self._settings)
            if known is not None and self.params.accumulate:
                # Keep what this sweep cannot see: behind the robot may be a girder that only the known map contains.
                new = mapping.renew(known, new) if self._is_doubted else mapping.merge(known, new, tolerance)
            known, self._is_doubted = new, False
            counts.update(shown.barriers.counts)
            stamp_ns = sweep.stamp_ns + round(1e9 * float(sweep.frame_times.max()))
        assert known is not None
        self._known = known
        return _message(known, stamp_ns, counts)

    def _outline(self, sweep: Sweep, given: MapperInput) -> Outline:
        track = given.track
        geometry = sweep.geometry if self.params.geometry == "as_sweep" else self.params.geometry
        image = SweepImage(sweep.ranges, sweep.pitches, sweep.frame_times, sweep.bearings,
                           (sweep.x, sweep.y, sweep.z), sweep.range_min, sweep.range_max, geometry)  # fmt: skip
        motion = frame_motion(sweep.stamp_ns, image.frame_times, (sweep.x, sweep.y), track.stamps_ns, track.poses,
                              slack=self.params.track_slack, deskew=self.params.deskew)  # fmt: skip
        return self._outline_of(image, motion)

    @abstractmethod
    def _outline_of(self, image: SweepImage, motion: FrameMotion) -> Outline:
        """Outlines of the obstacles seen by one sweep."""


class Ipabd(_OfSweeps[IpabdParams]):
    """Sweeps of a pitched laser to one 2D map (Hoang et al. 2013, section II)."""

    name = "ipabd"
    presets = {"robust": ROBUST, "printed": PRINTED}

    @classmethod
    def derived(cls, params: IpabdParams, robot: RobotSpec, period: float) -> Mapping[str, Derived]:
        return {"z_limit": Derived(robot.height, "height")}

    def _outline_of(self, image: SweepImage, motion: FrameMotion) -> Outline:
        return mapping.outline(image, motion, self._settings)


class Union(_OfSweeps[UnionParams]):
    """All pixels pressed to the plane (Hoang et al. 2013, Fig. 7): the map that IPaBD improves on, for comparison."""

    name = "union"
    disclaims = {Claim.ACCURATE: "It presses the floor to the plane with all else, as Fig. 7 of the paper does."}

    def _outline_of(self, image: SweepImage, motion: FrameMotion) -> Outline:
        return union_outline(image, motion, self._settings, self.params.keeps_floor)


def _message(known: GridMap, stamp_ns: int, counts: Counter[Rule]) -> MapUpdate:
    origin = Pose2D(*known.lattice.origin, 0.0)
    grid = OccupancyGrid(known.cells, known.lattice.resolution, origin)
    return MapUpdate(stamp_ns, grid, known.segments, tuple(Count(rule.name.lower(), counts[rule]) for rule in Rule))
