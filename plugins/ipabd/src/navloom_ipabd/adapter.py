"""IPaBD as a navloom mapper."""

from __future__ import annotations

from collections import Counter

from navloom import Context, Count, InputError, Mapper, MapperInput, MapUpdate, OccupancyGrid, Pose2D, Sweep

from navloom_ipabd import mapping
from navloom_ipabd.errors import DataError
from navloom_ipabd.mapping import GridMap, Outline
from navloom_ipabd.params import IpabdParams
from navloom_ipabd.rules import Rule
from navloom_ipabd.sweep import SweepImage
from navloom_ipabd.track import frame_motion

__all__ = ["Ipabd"]


class Ipabd(Mapper):
    """Sweeps of a pitched laser to one 2D map (Hoang et al. 2013, section II)."""

    name = "ipabd"
    accepts = (Sweep,)
    Params = IpabdParams

    def __init__(self, params: IpabdParams, context: Context) -> None:
        super().__init__(params, context)
        self._settings = params.settings(context.robot.height, (context.start.x, context.start.y))
        self._known: GridMap | None = None

    def reset(self) -> None:
        self._known = None

    @classmethod
    def warm_up(cls) -> None:
        mapping.warm_up()

    def update(self, given: MapperInput) -> MapUpdate | None:
        if given.clear:
            self._known = None
        elif not given.sweeps:
            return None
        try:
            return self._updated(given)
        except DataError as error:
            raise InputError(f"ipabd: {error}") from error

    def _updated(self, given: MapperInput) -> MapUpdate:
        known, stamp_ns, counts = self._known, given.stamp_ns, Counter[Rule]()
        for sweep in given.sweeps:
            shown = self._outline(sweep, given)
            new = mapping.draw(shown, self._settings)
            if known is not None and self.params.accumulate:
                new = mapping.merge(known, new, self._settings.line_tolerance)
            known = new
            counts.update(shown.barriers.counts)
            stamp_ns = sweep.stamp_ns + round(1e9 * float(sweep.frame_times.max()))
        self._known = known
        return _message(mapping.empty_map(self._settings) if known is None else known, stamp_ns, counts)

    def _outline(self, sweep: Sweep, given: MapperInput) -> Outline:
        track = given.track
        geometry = sweep.geometry if self.params.geometry == "as_sweep" else self.params.geometry
        image = SweepImage(sweep.ranges, sweep.pitches, sweep.frame_times, sweep.bearings,
                           (sweep.x, sweep.y, sweep.z), sweep.range_min, sweep.range_max, geometry)  # fmt: skip
        motion = frame_motion(sweep.stamp_ns, image.frame_times, (sweep.x, sweep.y), track.stamps_ns, track.poses,
                              slack=self.params.track_slack, deskew=self.params.deskew)  # fmt: skip
        return mapping.outline(image, motion, self._settings)


def _message(known: GridMap, stamp_ns: int, counts: Counter[Rule]) -> MapUpdate:
    origin = Pose2D(*known.lattice.origin, 0.0)
    grid = OccupancyGrid(known.cells, known.lattice.resolution, origin)
    return MapUpdate(stamp_ns, grid, known.segments, tuple(Count(rule.name.lower(), counts[rule]) for rule in Rule))
