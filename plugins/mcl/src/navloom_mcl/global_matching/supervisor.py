"""Finds the robot: searches the map in slices, follows the places that fit, and says when one of them is proven."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom_scan_localizer.tracking import Settings
from navloom_scans.anywhere import MapSearch
from navloom_scans.poses import compose, relative
from navloom_scans.sight import Sight, compare_views
from numpy.typing import NDArray

from navloom_mcl.finding import Finder
from navloom_mcl.global_matching.places import Place, Places

__all__ = ["Guess", "Search", "SearchLimits"]

Floats = NDArray[np.float64]
Guess = tuple[Floats, tuple[float, float]]

_TURN_AS = 0.3
"""Way that a turn of 1 rad counts as, m: a full turn on the spot shows all that there is to see there."""
_FEW = 20
"""Least number of echoes of a scan that is used."""
_PER_TICK = 4
"""Places of a search that are followed back along the drive in one tick."""
_WAY, _PAUSE = 0.7, 8.0
"""Way after which the map is searched again, m, and the longest time between two searches, s."""
_CONFIRMED = 0.3
"""Way that a place must have been followed when the search began that found no better one, m."""
_STRAY = 6.0
"""Largest loss in the log likelihood of a place far from a guess: a guess may be wrong."""
_FIT, _SEEN, _THROUGH = 0.35, 0.12, 0.15
"""Least share of the echoes, and of all beams, that must be at mapped walls at a place; largest share through them."""
_EXPLAINED, _KEPT_EXPLAINED = -1.6, -2.6
"""Least mean log likelihood of a scan of the drive: at a place, and where the robot was tracked until now. A scan of 60
beams, a third of them from unmapped things, has -1.6; the best place on the map of another building has -3."""
_UNIQUE, _UNIQUE_SCANS = (0.8, 0.4, 0.9995), 3
"""Least share of the echoes and of all beams at mapped walls, and least weight, of a place that needs no drive; number
of scans that show it."""
_CONTINUED, _BEYOND, _GATE = 0.6, 0.15, 0.16
"""Share of the beams that continue the last scan, and that pass through what it saw, from which the robot was carried;
gate of that comparison, m."""
_LONG = (0.3, math.radians(30.0))
"""Motion between two scans beyond which they are not compared, m and rad."""


@dataclass(frozen=True, slots=True)
class SearchLimits:
    """Limits of the search, see the README.

    Attributes:
        work: Work in one tick, in nodes.
        candidates: Places that one search of the map returns at most.
        prove_way: Way along which a place must fit, m.
        sure_weight: Least weight of a place that is tracked.
    """

    work: int = 60_000
    candidates: int = 40
    prove_way: float = 0.8
    sure_weight: float = 0.99


class Search:
    """One search for the robot, from the loss of its pose until it is found.

    Attributes:
        places: The places that fit.
        reason: What is known so far, in plain words.
    """

    def __init__(
        self,
        search: MapSearch,
        settings: Settings,
        limits: SearchLimits,
        odometry: Floats,
        guess: Guess | None,
        kept: tuple[Floats, Floats, float] | None = None,
    ) -> None:
        """Begin a search.

        Args:
            search: Search of the map.
            settings: Settings of the trackers.
            limits: Limits.
            odometry: (3,) x, y, m, heading, rad, odometry frame, now.
            guess: Where the robot may be, (3,) in the map frame, with standard deviations, m and rad; else None.
            kept: Where it was tracked until now, and may still be: (3,) pose, map frame, its (3, 3) covariance, and how
                much likelier it is than any other place, as a logarithm.
        """
        self.limits, self._odometry = limits, odometry.copy()
        self._map, self._finder = search, Finder(search, limits.candidates)
        self.places = Places(settings, search.field, odometry, _TURN_AS)
        self._guess, self._guess_at = guess, odometry.copy()
        self._is_near = guess is not None
        if kept is not None:
            self.places.add(kept[0], kept[2], kept[1])
        self._pending: list[Floats] = []
        self._view: tuple[Floats, int, Floats] | None = None
        """Beams, number of echoes and odometry pose of the last scan."""
        self._searched, self._waited = -math.inf, 0.0
        self._began = math.inf
        """Way at which the last search of the whole map that has ended began, m."""
        self._count, self._is_whole, self._finder_is_complete = 0, False, False
        self.reason = "the place is not known: the map is searched"

    def take_map(self, search: MapSearch) -> None:
        """Search another map from now on: the places stay where they are."""
        self._map, self._finder = search, Finder(search, self.limits.candidates)
        self.places.take_map(search.field)
        self._pending, self._searched, self._began = [], -math.inf, math.inf

    def step(self, odometry: Floats, time: float, beams: Floats, echoes: int) -> Place | None:
        """Continue by the beams of one tick, (n, 4) of which the first have an echo; the place, once it is proven.

        Args:
            odometry: (3,) x, y, m, heading, rad, odometry frame, now.
            time: Time since the last call, s.
            beams, echoes: As for `MapSearch.begin`.
        """
        places = self.places
        moved, self._odometry = relative(self._odometry, odometry), odometry.copy()
        self._pending = [compose(pose, moved) for pose in self._pending]
        self._waited += time
        places.advance(odometry, time)
        if echoes >= _FEW:
            self._notice_carrying(beams, echoes)
            places.see(beams, echoes)
            if not self._finder.is_busy and not self._pending and self._is_due():
                near = self._moved_guess() if self._is_near else None
                self._finder.begin(beams, echoes, odometry, *(near or ()))
                self._searched, self._waited = places.way, 0.0
        if (found := self._finder.step(self.limits.work, odometry)) is not None:
            self._pending = list(found.poses)
            self._count += 1
            if self._is_near:
                self._is_near, self._searched = False, -math.inf
            else:
                self._is_whole, self._finder_is_complete = True, self._map.is_complete
                self._began = self._searched
        for pose in self._pending[:_PER_TICK]:
            places.add(pose, self._prior(pose))
        self._pending = self._pending[_PER_TICK:]
        proven = self._proven()
        self.reason = "" if proven else self._doubt()
        return proven

    def _notice_carrying(self, beams: Floats, echoes: int) -> None:
        """Begin again if a scan does not continue the last one: the robot was carried, or odometry is wrong."""
        last, self._view = self._view, (beams, echoes, self._odometry)
        if last is None:
            return
        step = relative(last[2], self._odometry)
        if math.hypot(step[0], step[1]) > _LONG[0] or abs(step[2]) > _LONG[1]:
            return
        same, beyond = compare_views(last[0], last[1], beams, echoes, step, _GATE)
        if same < _CONTINUED and beyond > _BEYOND:
            self.places.restart()
            self._finder.stop()
            self._guess, self._is_near, self._is_whole, self._pending = None, False, False, []
            self._searched, self._began = -math.inf, math.inf

    def _is_due(self) -> bool:
        return self.places.way - self._searched >= _WAY or self._waited >= _PAUSE or math.isinf(self._searched)

    def _moved_guess(self) -> Guess | None:
        if self._guess is None:
            return None
        pose, sigma = self._guess
        return compose(pose, relative(self._guess_at, self._odometry)), sigma

    def _prior(self, pose: Floats) -> float:
        """Logarithm of how likely a place is by the guess."""
        guess = self._moved_guess()
        if guess is None:
            return 0.0
        near, sigma = guess
        off = math.hypot(pose[0] - near[0], pose[1] - near[1]) / sigma[0]
        turned = math.remainder(pose[2] - near[2], math.tau) / sigma[1]
        return -min(0.5 * (off * off + turned * turned), _STRAY)

    def _proven(self) -> Place | None:
        """The place that has fitted along a drive, while no other one does, if there is one."""
        if not self.places.found or self._pending:
            return None
        best, limits = self.places.found[0], self.limits
        if best.weight < limits.sure_weight or not self._is_whole or not self._fits(best):
            return None
        if self._is_unique(best):
            return best
        # A search of the whole map on the way has found nothing better.
        began = self._began - (self.places.way - best.way)
        return best if best.way >= limits.prove_way and began >= _CONFIRMED else None

    def _is_unique(self, place: Place) -> bool:
        """Whether one view is enough: nearly all of it is on the map, and it looks like no other place."""
        seen = Sight(*place.counts.tolist())
        echoes = seen.fit + seen.behind + seen.elsewhere
        is_all = seen.fit >= _UNIQUE[0] * echoes and seen.fit >= _UNIQUE[1] * seen.total
        return is_all and place.weight >= _UNIQUE[2] and len(place.logs) >= _UNIQUE_SCANS and self._finder_is_complete

    def _fits(self, place: Place) -> bool:
        seen = Sight(*place.counts.tolist())
        echoes = max(seen.fit + seen.behind + seen.elsewhere, 1e-9)
        least = _KEPT_EXPLAINED if place.prior > 0.0 else _EXPLAINED
        is_seen = seen.fit >= max(_FIT * echoes, _SEEN * seen.total) and place.mean >= least
        return is_seen and seen.through <= _THROUGH * max(seen.fit + seen.through, 1e-9)

    def _doubt(self) -> str:
        """What is known so far."""
        found, limits = self.places.found, self.limits
        if not found:
            if self._count:
                return "no place on the map fits what the robot sees"
            return "the place is not known: the map is searched"
        if found[0].weight < limits.sure_weight:
            count = sum(place.weight >= 1.0 - limits.sure_weight for place in found)
            return f"{count} places fit, the likeliest with a weight of {found[0].weight:.0%}: a drive tells them apart"
        if not self._fits(found[0]):
            return "one place fits better than others, but not well"
        way = min(found[0].way, limits.prove_way)
        if way < limits.prove_way:
            return f"one place fits, along {way:.1f} m of {limits.prove_way:g} m so far"
        return "one place fits; the map is searched for others"
