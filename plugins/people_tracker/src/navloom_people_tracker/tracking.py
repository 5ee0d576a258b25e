"""Follows bodies from scan to scan: which of them move, when a track begins, and when it ends."""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol

import numpy as np
from navloom.geometry.frames import compose, inverse, transform
from numpy.typing import NDArray

from navloom_people_tracker.bodies import SIGMA_ARC, Bodies, Widths, bodies_in
from navloom_people_tracker.circles import on_circles
from navloom_people_tracker.kalman import assign, combined, common_turn, measure, mixed, moved, predict, rest
from navloom_people_tracker.tracks import Tracks, begun
from navloom_people_tracker.views import View, are_fresh, cover, looked_through, view_of

__all__ = ["Settings", "Tracker"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

VIEW_EVERY, VIEWS = 0.3, 14
"""Time between the scans that are kept as views, s, and how many are: the oldest is 4 s old."""
MARK_EVERY = 0.1
"""Time between the marks of a track, s."""
LEAST_AGE = 0.3
"""Least age of a view or mark that tells what moved, s: at 0.5 m/s a body has moved by more than the noise then."""
STOOD = 0.8
"""Age of a view, s, from which an echo at a place says that a body stands there: a slow one has left it by then."""
DRIFT = 0.04
"""Error of the odometry, m/m and rad/rad: wheels slip."""
SLIP, LEAST_SLIP = 0.02, 1e-4
"""Standard deviation of the turn that wheels miss, rad/√m, and the least one that is looked for, rad. The wheels of
`explore` miss twice as much, but bodies turn by themselves, too."""
EVIDENCE_LASTS, EVIDENCE_NEEDED, EVIDENCE_KEPT = 0.5, 0.2, 0.05
"""How long evidence of motion lasts, how much begins a motion, and how much less ends it, s."""
LEAST_ECHOES = 2
"""Fewest echoes of a body whose motion is seen."""
LEAST_MARKS = 4
"""Fewest places from which a velocity is told."""
TRAVEL, LEAST_SPEED = 0.2, 0.15
"""Least way of a track that moves within the time of its marks, m, and its least speed, m/s: shapes flicker by less."""
STEADY = 0.82
"""Share of the variance of the places that a straight motion explains: of a single jump it explains at most 0.75."""
DISC_SIGMA = 0.05
"""Standard deviation of the radius of a track below which it is a disc, whose hidden part is known, m."""
LEAST_RADIUS_SIGMA = 0.005
"""What each scan adds to the standard deviation of the radius, m: readings at its edges have common errors."""
LEAST_PRIOR = 0.1
"""Least standard deviation of the expected centre of a disc in its fit, m."""
LEAST_NOISE = 0.01
"""Least standard deviation of a range in a fit, m."""
SURE_SPEED, DISC_TRAVEL = 0.3, 0.3
"""Least speed of a disc that moves without evidence from free space, m/s, and its least way, m."""
TURN = 10.0
"""Standard deviation of the acceleration of a body that turns or brakes, m/s²."""
REST_AFTER = 0.8
"""Age from which a track without evidence of motion rests, s: longer than evidence takes to come."""
REST_SIGMA = 0.05
"""Standard deviation of the speed of a body that rests, m/s."""
THROUGH, THROUGH_TENTATIVE = 0.4, 0.2
"""How long beams pass through the place of a track before it ends, s; and of a tentative one."""
MOST_SIGMA = 2.0
"""Standard deviation of a place from which a track ends, m: another body would be taken for it."""
OVERLAP = 0.6
"""Distance of two bodies from which they are one, as a share of the sum of their radii."""
ALIKE = 0.5
"""Largest difference of the velocities of two tracks that may be of one body, m/s."""
BESIDE = 1.0
"""How long echoes at the place of a track may belong to something else before it ends, s."""
ABSORBS = 0.7
"""Distance from a published track with legs within which a leg begins no track of its own, m."""


class Settings(Widths, Protocol):
    """The settings of a tracker; see the parameters of the node."""

    @property
    def acceleration(self) -> float: ...
    @property
    def longest_unseen(self) -> float: ...
    @property
    def still_after(self) -> float: ...
    @property
    def range_sigma(self) -> float: ...


class Tracker:
    """Tracks of the bodies that move, and of those that stand where a map has nothing.

    Attributes:
        tracks: All tracks, tentative ones too, in a frame of their own: the odometry's without the turns that the
            wheels missed.
        time: Time of the last scan, s.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.tracks = begun(Bodies.of(np.empty((0, 9)), np.empty((0, 6)), np.empty(0, np.int64), (0.0, 0.0)), 0.0)
        self.time = math.nan
        self._count = 0
        self._views: dict[str, deque[View]] = {}
        self._marked = -math.inf
        self._pose: Floats | None = None
        self._way, self._rates = np.zeros(2), np.zeros(2)
        self._steady = np.zeros(3)  # pose of the odometry frame in that of the tracks, m and rad

    def published(self, time: float) -> Tracks:
        """The tracks with a number, predicted to a time, s, in the odometry frame."""
        found = self.tracks.rows(self.tracks.ids > 0)
        ahead = max(0.0, time - self.time) if len(found.ids) else 0.0
        states = predict(found.means, found.covariances, ahead, self.settings.acceleration)
        found.means, found.covariances = moved(*states, inverse(self._steady))
        return found

    def see(self, time: float, sensor: str, pose: Floats, beams: Floats, step: float, mapped: Ints) -> None:
        """Take a scan.

        Args:
            time: Its stamp, s. A scan that is older than the previous one counts as one of that time.
            sensor: Its name.
            pose: (3,) of the robot, m, rad, odometry frame.
            beams: (n, 5) as those of `views.place_beams`, odometry frame; at least one.
            step: Angle between neighbouring beams, rad.
            mapped: (n,) 1 for an echo that is not looked at, as a map explains it; 0 where a map is free, else -1.
        """
        since = 0.0 if math.isnan(self.time) else max(0.0, time - self.time)
        self.time = time if math.isnan(self.time) else max(self.time, time)
        self._drive(pose, since)
        driven, turned = self._way.tolist()
        beams = np.column_stack(
            [transform(self._steady, beams[:, :2]), transform(self._steady, beams[:, 2:4]), beams[:, 4]]
        )
        eye = float(beams[:, 0].mean()), float(beams[:, 1].mean())
        self._predict(since)
        bodies, points, labels = self._bodies(sensor, eye, beams, step, mapped)
        rows, columns = self._matched(bodies)
        turn = self._missed_turn(rows, bodies.rows(columns), eye, since)
        if turn is not None:
            for places in (bodies.places, bodies.surfaces, points, beams[:, 2:4]):
                places[:] = transform(turn, places)
            self._steady = compose(turn, self._steady)
        view = view_of(self.time, (driven, turned), eye, beams, max(90, round(math.tau / step)))
        self._correct(rows, bodies.rows(columns), points, labels)
        self._judge_motion(rows, bodies.rows(columns), view, since)
        self._name()
        is_kept = self._kept(rows, view, since)
        self._begin(bodies, rows, columns, is_kept)
        self._remember(sensor, view)

    def _missed_turn(self, rows: Ints, bodies: Bodies, eye: tuple[float, float], since: float) -> Floats | None:
        """Motion (3,), m, rad, that turns a scan about its sensor by what the wheels missed since the last one.

        All bodies that move seem to turn at once. None with fewer than two of them, and for a robot that stood.
        """
        tracks, (driven, turned) = self.tracks, self._rates * since
        told = tracks.ids[rows] > 0
        rows, bodies = rows[told], bodies.rows(told)
        sigma = math.sqrt(SLIP**2 * driven + (DRIFT * turned) ** 2)
        if len(rows) < 2 or sigma < LEAST_SLIP:
            return None
        places, errors = bodies.centred(tracks.radii[rows], tracks.radius_sigmas[rows])
        angle = common_turn(tracks.means[rows], tracks.covariances[rows], places, errors, eye, sigma)
        x, y = (np.array(eye) - transform((0.0, 0.0, angle), eye)).tolist()
        return np.array([x, y, angle])

    def _predict(self, since: float) -> None:
        tracks, accelerations = self.tracks, np.array([self.settings.acceleration, TURN])
        chances, modes, covariances = mixed(tracks.chances, tracks.modes, tracks.mode_covariances, since)
        tracks.chances = chances
        tracks.modes, tracks.mode_covariances = predict(modes, covariances, since, accelerations)
        tracks.means, tracks.covariances = combined(chances, tracks.modes, tracks.mode_covariances)

    def _drive(self, pose: Floats, since: float) -> None:
        if self._pose is not None:
            moved = pose - self._pose
            step = np.array([math.hypot(moved[0], moved[1]), abs(math.remainder(moved[2], math.tau))])
            self._way += step
            if since > 0.0:
                self._rates = step / since
        self._pose = np.array(pose)

    def _margins(self, ways: Floats) -> Floats:
        """(n, 2) margins of `looked_through` since the robot had gone some ways, (n, 2) m and rad."""
        gone = np.abs(self._way - ways)
        # Readings differ by their noise, and the places by the drift of the odometry.
        return np.column_stack([0.06 + 3.0 * self.settings.range_sigma + DRIFT * gone[:, 0], 0.01 + DRIFT * gone[:, 1]])

    def _bodies(
        self, sensor: str, eye: tuple[float, float], beams: Floats, step: float, mapped: Ints
    ) -> tuple[Bodies, Floats, Ints]:
        looked_at = np.flatnonzero((beams[:, 4] > 0.0) & (mapped < 1))
        around = np.arctan2(beams[looked_at, 3] - eye[1], beams[looked_at, 2] - eye[0])
        looked_at = looked_at[np.argsort(around, kind="stable")]
        points = np.ascontiguousarray(beams[looked_at, 2:4])
        tracks = self.tracks
        radii = np.where(self._are_discs(), tracks.radii, 0.0)
        expected = np.column_stack([tracks.means[:, :2], radii])[tracks.ids > 0]
        marks = np.column_stack([self._fresh(sensor, points), mapped[looked_at] == 0])
        return bodies_in(points, marks, eye, step, expected, self.settings)

    def _fresh(self, sensor: str, points: Floats) -> Bools:
        """(n,) whether an earlier view looked through the place of each echo, and none after it shows what stood."""
        fresh = np.zeros(len(points), np.bool_)
        views = [view for view in self._views.get(sensor, ()) if self.time - view.time >= LEAST_AGE]
        if not views or self.time - views[0].time < STOOD:
            return fresh  # what stands is not known yet
        eyes = np.array([(view.x, view.y, view.driven, view.turned, view.time) for view in views])
        are_old = self.time - eyes[:, 4] >= STOOD
        nears = np.stack([view.near for view in views])
        are_fresh(nears, eyes[:, :2], self._margins(eyes[:, 2:4]), are_old, points, fresh)
        return fresh

    def _matched(self, bodies: Bodies) -> tuple[Ints, Ints]:
        """Rows of tracks and of their bodies; the published tracks choose first."""
        tracks, free = self.tracks, np.arange(len(bodies.places))
        rows, columns = [], []
        for own in (np.flatnonzero(tracks.ids > 0), np.flatnonzero(tracks.ids == 0)):
            given = bodies.places[free], bodies.errors[free]
            found, taken = assign(tracks.means[own], tracks.covariances[own], *given)
            rows.append(own[found])
            columns.append(free[taken])
            free = np.delete(free, taken)
        return np.concatenate(rows), np.concatenate(columns)

    def _are_discs(self) -> Bools:
        return np.asarray(self.tracks.radius_sigmas < DISC_SIGMA)

    def _centres(self, rows: Ints, bodies: Bodies, points: Floats, labels: Ints) -> tuple[Floats, Floats]:
        """(n, 2) measured centres, m, of tracks, and (n, 2, 2) covariances, m²."""
        tracks = self.tracks
        places, errors = bodies.centred(tracks.radii[rows], tracks.radius_sigmas[rows])
        those = np.flatnonzero(self._are_discs()[rows])
        own = rows[those]
        circles, found = np.column_stack([tracks.means[own, :2], tracks.radii[own]]), np.empty((len(own), 5))
        priors = 2.0 * np.sqrt(np.trace(tracks.covariances[own, :2, :2], axis1=1, axis2=2) + LEAST_PRIOR**2)
        noise = max(self.settings.range_sigma, LEAST_NOISE)
        on_circles(points, labels, bodies.groups[those], circles, tracks.radius_sigmas[own], noise, priors, found)
        fits = np.isfinite(found[:, 0])
        places[those[fits]] = found[fits, :2]
        errors[those[fits]] = found[fits][:, [2, 3, 3, 4]].reshape(-1, 2, 2) + SIGMA_ARC**2 * np.eye(2)
        return places, errors

    def _correct(self, rows: Ints, bodies: Bodies, points: Floats, labels: Ints) -> None:
        tracks = self.tracks
        given = self._centres(rows, bodies, points, labels)
        modes, covariances, likelihoods = measure(
            tracks.modes[rows], tracks.mode_covariances[rows], given[0][:, None], given[1][:, None]
        )
        chances = tracks.chances[rows] * np.exp(likelihoods - likelihoods.max(axis=1, keepdims=True))
        self._set(rows, chances / chances.sum(axis=1, keepdims=True), modes, covariances)
        grown = bodies.radii - tracks.radii[rows]
        is_arc = np.isfinite(bodies.radius_sigmas)
        variances, told = tracks.radius_sigmas[rows] ** 2, np.where(is_arc, bodies.radius_sigmas, 1.0) ** 2
        # What is hidden in part looks narrower than it is.
        gains = np.where(self._are_discs()[rows], 0.0, np.where(grown > 0.0, 0.3, 0.03))
        gains = np.where(is_arc, variances / (variances + told), gains)
        tracks.radii[rows] += gains * grown
        tracks.radius_sigmas[rows] = np.where(
            is_arc, np.sqrt((1.0 - gains) * variances + LEAST_RADIUS_SIGMA**2), tracks.radius_sigmas[rows]
        )
        tracks.places[rows], tracks.seen[rows] = given[0], self.time
        tracks.is_in_free[rows] = bodies.is_in_free
        tracks.through[rows] = tracks.beside[rows] = 0.0
        if self.time - self._marked >= MARK_EVERY - 1e-9:
            self._marked = self.time
            tracks.marks[:, 1:] = tracks.marks[:, :-1].copy()
            tracks.marks[:, 0] = np.nan
            tracks.marks[rows, 0, :2] = bodies.surfaces
            tracks.marks[rows, 0, 2:4] = given[0]
            tracks.marks[rows, 0, 4:] = (self.time, *self._way)

    def _judge_motion(self, rows: Ints, bodies: Bodies, view: View, since: float) -> None:
        """Begin and end motions: by what came into free space, what left its place, and how steadily the track went."""
        tracks = self.tracks
        ages = self.time - tracks.marks[:, :, 4]
        said, marks = np.empty(ages.size, np.int64), tracks.marks.reshape(-1, 7)
        looked_through(view.near, view.x, view.y, marks[:, :2], self._margins(marks[:, 5:]), said)
        moves: Bools = np.asarray(((said.reshape(ages.shape) > 0) & (ages >= LEAST_AGE)).any(axis=1))
        moves[rows[bodies.fresh >= 0.5]] = True
        # A pole that is thinner than the beams are apart comes and goes.
        moves[rows[bodies.echoes < LEAST_ECHOES]] = False
        is_seen = np.zeros(len(moves), np.bool_)
        is_seen[rows] = True
        tracks.evidence[is_seen] *= math.exp(-since / EVIDENCE_LASTS)
        tracks.evidence[is_seen & moves] += since
        velocities, spans, is_steady = straight_motion(tracks.marks[:, :, 2:5])
        speeds = np.hypot(velocities[:, 0], velocities[:, 1])
        is_far = (speeds * spans > TRAVEL) & (speeds > LEAST_SPEED)
        is_sure, may_move = self._discs_move(view, np.where(is_steady, speeds, 0.0))
        is_sure &= is_seen
        starts = is_seen & ~tracks.is_moving & is_far & is_steady & (tracks.evidence > EVIDENCE_NEEDED)
        starts &= np.isfinite(tracks.marks[:, :, 4]).sum(axis=1) >= LEAST_MARKS
        # What is round and came into free space is no part of a wall that came into view.
        starts |= is_seen & (tracks.evidence > EVIDENCE_NEEDED) & may_move
        gone = is_steady & (speeds * spans > DISC_TRAVEL)
        starts |= is_sure & ((tracks.evidence > EVIDENCE_KEPT) | gone)
        stops = tracks.is_moving & is_seen & ~(is_far & (tracks.evidence > EVIDENCE_KEPT)) & ~may_move
        tracks.is_moving = (tracks.is_moving | starts) & ~stops
        rests = np.flatnonzero(
            is_seen & ~tracks.is_moving & (self.time - tracks.born > REST_AFTER) & ~(may_move & gone)
        )
        rests = rests[tracks.evidence[rests] < EVIDENCE_KEPT]
        modes, covariances = rest(tracks.modes[rests], tracks.mode_covariances[rests], REST_SIGMA)
        self._set(rests, tracks.chances[rests], modes, covariances)

    def _discs_move(self, view: View, speeds: Floats) -> tuple[Bools, Bools]:
        """(n,) discs that move beyond the error of their speed and of the odometry, and beyond that of the odometry.

        A part of a wall is no disc, so these need no evidence from free space.

        Args:
            view: The newest.
            speeds: (n,) by the places of each in a straight motion, m/s; 0 without one. The state of a track that was
                taken to rest does not tell any more that it moves.
        """
        tracks = self.tracks
        away = np.hypot(tracks.means[:, 0] - view.x, tracks.means[:, 1] - view.y)
        drift = DRIFT * (self._rates[0] + self._rates[1] * away)
        least = np.hypot(SURE_SPEED, 3.0 * drift)
        now = np.hypot(tracks.means[:, 2], tracks.means[:, 3])
        sigmas = np.sqrt(tracks.covariances[:, [2, 3], [2, 3]].sum(axis=1))
        are_discs = self._are_discs()
        return are_discs & (now - least > 3.0 * sigmas), are_discs & (np.maximum(now, speeds) > least)

    def _set(self, rows: Ints, chances: Floats, modes: Floats, covariances: Floats) -> None:
        tracks = self.tracks
        tracks.chances[rows], tracks.modes[rows], tracks.mode_covariances[rows] = chances, modes, covariances
        tracks.means[rows], tracks.covariances[rows] = combined(chances, modes, covariances)

    def _name(self) -> None:
        """Number the tentative tracks that move, and those that have stood for a while where a map has nothing."""
        tracks = self.tracks
        stands = tracks.is_in_free & (self.time - tracks.born >= self.settings.still_after)
        is_due = tracks.is_moving | (stands & (2.0 * tracks.radii <= self.settings.widest_still))
        for row in np.flatnonzero(is_due & (tracks.ids == 0)):
            self._count += 1
            tracks.ids[row] = self._count

    def _kept(self, rows: Ints, view: View, since: float) -> Bools:
        """(n,) which tracks go on: not those whose place is seen to be empty, or that were unseen for too long."""
        tracks = self.tracks
        is_missing = np.ones(len(tracks.ids), np.bool_)
        is_missing[rows] = False
        missing = np.flatnonzero(is_missing)
        said = np.empty(len(missing), np.int64)
        cover(view.near, view.x, view.y, tracks.means[missing, :2], tracks.radii[missing], said)
        tracks.through[missing[said > 0]] += since
        tracks.beside[missing[said == 0]] += since
        is_named = tracks.ids > 0
        is_empty = tracks.through >= np.where(is_named, THROUGH, THROUGH_TENTATIVE)
        is_old = self.time - tracks.seen > np.where(is_named, self.settings.longest_unseen, THROUGH)
        is_lost = np.hypot(*tracks.covariances[:, [0, 1], [0, 1]].T ** 0.5) > MOST_SIGMA
        ends: Bools = is_empty | is_old | is_lost | (tracks.beside > BESIDE) | self._doubles()
        return ~ends

    def _doubles(self) -> Bools:
        """(n,) tracks that overlap an older one by more than bodies can: parts of one, or its track from before."""
        tracks = self.tracks
        away = np.hypot(*(tracks.means[:, None, :2] - tracks.means[None, :, :2]).transpose(2, 0, 1))
        near = away < OVERLAP * (tracks.radii[:, None] + tracks.radii[None])
        # People who pass close by are not alike in their velocities.
        apart = np.hypot(*(tracks.means[:, None, 2:] - tracks.means[None, :, 2:]).transpose(2, 0, 1))
        near &= (apart < ALIKE) | ~tracks.is_moving[:, None]
        # The older one by its number; of tentative ones, both may be legs.
        is_older = (tracks.ids[None] > 0) & ((tracks.ids[:, None] == 0) | (tracks.ids[None] < tracks.ids[:, None]))
        is_seen = tracks.seen == self.time
        return np.asarray((near & is_older & is_seen[None]).any(axis=1))

    def _begin(self, bodies: Bodies, rows: Ints, columns: Ints, is_kept: Bools) -> None:
        """Begin tentative tracks of the bodies without one, and drop those that end."""
        tracks = self.tracks
        new = bodies.rows(np.delete(np.arange(len(bodies.places)), columns))
        hosts = tracks.means[rows[(tracks.ids[rows] > 0) & (bodies.legs[columns] > 0)], :2]
        if len(hosts) and len(new.places):
            away = np.hypot(*(new.places[:, None] - hosts[None]).transpose(2, 0, 1)).min(axis=1)
            new = new.rows((new.legs == 0) | (away > ABSORBS))
        self.tracks = tracks.rows(is_kept).joined(begun(new, self.time))

    def _remember(self, sensor: str, view: View) -> None:
        views = self._views.setdefault(sensor, deque(maxlen=VIEWS))
        if views and len(views[0].near) != len(view.near):
            views.clear()  # a scanner that was set to other beams
        if not views or view.time - views[-1].time >= VIEW_EVERY - 1e-9:
            views.append(view)


def straight_motion(marks: Floats) -> tuple[Floats, Floats, Bools]:
    """Velocities (n, 2), m/s, of least squares through places; the times (n,), s, they span; whether they are steady.

    Args:
        marks: (n, k, 3) x, y, m, and time, s, the newest first; NaN for none.
    """
    known = np.isfinite(marks[:, :, 2])
    count = known.sum(axis=1)
    given = np.where(known[:, :, None], marks, 0.0)
    middle = given.sum(axis=1) / np.maximum(count, 1)[:, None]
    apart = np.where(known[:, :, None], given - middle[:, None], 0.0)
    spread = np.maximum((apart[:, :, 2] ** 2).sum(axis=1), 1e-12)
    velocities = (apart[:, :, :2] * apart[:, :, 2:]).sum(axis=1) / spread[:, None]
    explained = (velocities**2).sum(axis=1) * spread
    variance = (apart[:, :, :2] ** 2).sum(axis=(1, 2))
    is_steady = (count > 1) & (explained > STEADY * variance)
    spans = np.where(known, apart[:, :, 2], -np.inf).max(axis=1) - np.where(known, apart[:, :, 2], np.inf).min(axis=1)
    return velocities, np.where(count > 1, spans, 0.0), is_steady
