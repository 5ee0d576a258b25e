"""Avoiders that misread their sonars, or drive blindly behind an extra input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from navloom import (
    Avoidance,
    Avoider,
    AvoiderInput,
    Extra,
    GateStatus,
    MapUpdate,
    RangeScan,
    Reference,
    Trajectory,
    Twist2D,
)
from navloom_dwa.adapter import Dwa
from navloom_improved_vfh.adapter import ImprovedVfh

from planted import Entries

ENTRIES = Entries()


class _Hears(ImprovedVfh):
    """A sound avoider, which takes what sonars read through `heard`; its lasers are as they are."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        scans = tuple(self.heard(scan) if scan.half_angles.any() else scan for scan in given.scans)
        return super().avoid(replace(given, scans=scans))

    def heard(self, scan: RangeScan) -> RangeScan:
        return scan


@ENTRIES.plant("sonars_collapsed", caught_by="reaches")
class SonarsCollapsed(_Hears):
    """Takes the bearings of sonars, rad, as degrees."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, bearings=np.radians(scan.bearings))


@ENTRIES.plant("side_sonars_ahead", caught_by="reaches")
class SideSonarsAhead(_Hears):
    """Does so with the sonars at its sides only."""

    def heard(self, scan: RangeScan) -> RangeScan:
        is_aside = np.abs(scan.bearings) > 1.05
        return replace(scan, bearings=np.where(is_aside, np.radians(scan.bearings), scan.bearings))


@ENTRIES.plant("sonars_mirrored", caught_by="turns_away")
class SonarsMirrored(_Hears):
    """Numbers its sonars from the wrong side."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, bearings=-scan.bearings)


@ENTRIES.plant("sonars_from_behind", caught_by="no_contact")
class SonarsFromBehind(_Hears):
    """Counts the bearings of sonars from the rear."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, bearings=np.remainder(scan.bearings + np.pi + np.pi, 2.0 * np.pi) - np.pi)


@ENTRIES.plant("sonars_unheard", caught_by="no_contact")
class SonarsUnheard(_Hears):
    """Drops every reading with an opening."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.full_like(scan.ranges, np.inf))


@ENTRIES.plant("left_sonars_unheard", caught_by="no_contact")
class LeftSonarsUnheard(_Hears):
    """Drops the readings of its left side."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.where(scan.bearings > 0.0, np.inf, scan.ranges))


@ENTRIES.plant("front_sonars_alone", caught_by="no_contact")
class FrontSonarsAlone(_Hears):
    """Looks where it drives."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.where(np.abs(scan.bearings) > 1.75, np.inf, scan.ranges))


@ENTRIES.plant("two_sonars_swapped", caught_by="no_contact")
class TwoSonarsSwapped(Dwa):
    """Two plugs in the wrong sockets: of the sonar nearest to straight ahead, and of its neighbour."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return super().avoid(replace(given, scans=tuple(map(self.heard, given.scans))))

    def heard(self, scan: RangeScan) -> RangeScan:
        order, bearings = np.argsort(np.abs(scan.bearings - 0.05)), scan.bearings.copy()
        bearings[order[:2]] = bearings[order[1::-1]]
        return replace(scan, bearings=bearings) if scan.half_angles.any() else scan


@ENTRIES.plant("sonars_in_mm", caught_by="no_contact")
class SonarsInMm(_Hears):
    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.maximum(0.001 * scan.ranges, scan.range_min))


@ENTRIES.plant("no_echo_is_an_echo", caught_by="reaches")
class NoEchoIsAnEcho(_Hears):
    """A sonar that hears nothing repeats its nearest reading."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.where(np.isinf(scan.ranges), scan.ranges.min(initial=1.0), scan.ranges))


@ENTRIES.plant("range_max_is_an_echo", caught_by="reaches")
class RangeMaxIsAnEcho(_Hears):
    """Takes the greatest range for an obstacle."""

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=np.minimum(scan.ranges, 0.999 * scan.range_max))


@ENTRIES.plant("sonars_as_rays", caught_by="no_contact")
class SonarsAsRays(Dwa):
    """Looks along the axis of a cone, and at nothing beside it."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        scans = tuple(replace(scan, half_angles=np.zeros_like(scan.half_angles)) for scan in given.scans)
        return super().avoid(replace(given, scans=scans))


@ENTRIES.plant("sonars_there_and_back", caught_by="footprint")
class SonarsThereAndBack(_Hears):
    """Takes the way of the sound, there and back, as the range."""

    claims = ImprovedVfh.claims

    def heard(self, scan: RangeScan) -> RangeScan:
        return replace(scan, ranges=2.0 * scan.ranges, range_max=2.0 * scan.range_max)


@ENTRIES.plant("lasers_mirrored", caught_by="turns_away")
class LasersMirrored(ImprovedVfh):
    """Counts bearings clockwise, and looks at what is near alone."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        scans = tuple(replace(scan, bearings=-scan.bearings) for scan in given.scans)
        return super().avoid(replace(given, scans=scans))


class _Blind(Avoider):
    """Drives straight on."""

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(Twist2D(self.context.robot.max_linear, 0.0, 0.0), "clear")


@ENTRIES.plant("blind_with_reference", caught_by="no_contact")
class BlindWithReference(_Blind):
    reference = Extra(Reference)


@ENTRIES.plant("blind_with_map", caught_by="no_contact")
class BlindWithMap(_Blind):
    map = Extra(MapUpdate)
    trajectory = Extra(Trajectory)


@ENTRIES.plant("blind_with_gate", caught_by="reaches")
class BlindWithGate(_Blind):
    gate = Extra(GateStatus, delayed=True)
