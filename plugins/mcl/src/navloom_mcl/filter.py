"""The particle filter: what is believed of the robot's pose, as weighted samples (Monte Carlo localisation)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from navloom_scans import sight
from navloom_scans.field import DistanceField
from numpy.typing import NDArray

from navloom_mcl import clusters, likelihood, sampling
from navloom_mcl.clusters import Places, clusters_of, moments
from navloom_mcl.likelihood import log_likelihoods, moved, weighed
from navloom_mcl.sampling import bins_of, resampled, sample_size

__all__ = ["FilterSettings", "ParticleFilter", "Places", "warm_up"]

Floats = NDArray[np.float64]

_MOST_PLACES = 64
"""Most hypotheses, as in the framework's message."""
_LIKELY = 0.02
"""Weight from which a place has particles of its own."""
_EVEN = 0.5
"""Share of the particles that must count, by their effective number, for a set to be kept without resampling."""


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings of the filter: lengths in m, angles in rad; the README explains each.

    Attributes:
        least, most: Limits of the number of particles; each place keeps half of `least`.
        kld_error, kld_quantile: Largest Kullback-Leibler distance, and the normal quantile of its probability.
        bin_size, bin_turns: Edge of a bin, m, and bins in a full turn.
        way_noise, turn_per_way, turn_noise, rest_noise, rest_turn_noise: Spread of odometry, see `likelihood.moved`.
        beams: Number of beams of a scan that are used.
        sigma: Standard deviation of a hit, m.
        short, through, silent: Likelihood, relative to that of a hit, of an echo of something unmapped, of one through
            a wall, and of a missing echo through a wall.
        gate: Depth behind a wall's front from which a beam passes through it, m.
        redundancy: Number of beams that count as one independent measurement.
    """

    least: int = 500
    most: int = 5000
    kld_error: float = 0.05
    kld_quantile: float = 2.326
    bin_size: float = 0.25
    bin_turns: int = 36
    way_noise: float = 0.05
    turn_per_way: float = math.radians(3.0)
    turn_noise: float = math.radians(3.0)
    rest_noise: float = 0.002
    rest_turn_noise: float = math.radians(0.1)
    beams: int = 60
    sigma: float = 0.08
    short: float = 0.2
    through: float = 0.05
    silent: float = 0.3
    gate: float = 0.24
    redundancy: float = 6.0


class ParticleFilter:
    """Weighted samples of the robot's pose. It starts empty: `spread` gives it particles.

    Attributes:
        settings: May be replaced at any time.
        field: Distance field of the map; may be replaced at any time.
        particles: (n, 3) x, y, m, heading, rad in [-π, π), map frame.
        weights: (n,) their sum is 1.
    """

    def __init__(self, field: DistanceField, settings: FilterSettings, random: np.random.Generator) -> None:
        self.settings, self.field, self._random = settings, field, random
        self._part = 0
        self._places: Places | None = None
        self.clear()

    def spread(self, poses: Floats, covariances: Floats, weights: Floats | None = None, count: int = 0) -> None:
        """Replace all particles by samples of a mixture of normal distributions.

        Args:
            poses: (k, 3) means: x, y, m, heading, rad, map frame.
            covariances: (k, 3, 3), or (3, 3) for all; m², m rad, rad².
            weights: (k,) not negative; equal by default.
            count: Number of particles; the most that the settings allow by default.
        """
        count = count or self.settings.most
        self.particles = self._drawn(poses, covariances, weights, count)
        self.weights, self._places = np.full(count, 1.0 / count), None

    def clear(self) -> None:
        """Drop all particles."""
        self.particles, self.weights, self._places = np.empty((0, 3)), np.empty(0), None

    def inject(self, poses: Floats, covariances: Floats, weights: Floats | None, share: float) -> None:
        """Add samples of a mixture, as for `spread`, which then hold a share of the weight, 0 to 1.

        Of the present particles, as many are kept as the limit allows, by resampling.
        """
        if not len(self.particles) or share >= 1.0:
            self.spread(poses, covariances, weights)
            return
        count = max(1, min(round(share * self.settings.most), self.settings.most - 1))
        if len(self.particles) + count > self.settings.most:
            self._resample(self.settings.most - count)
        added = self._drawn(poses, covariances, weights, count)
        self.particles = np.concatenate((self.particles, added))
        self.weights = np.concatenate(((1.0 - share) * self.weights, np.full(count, share / count)))
        self._places = None

    def predict(self, step: Floats, time: float) -> None:
        """Move the particles by a step of odometry, (3,) x, y, m, heading, rad, base frame, that took a time, s."""
        if not len(self.particles):
            return
        s, noise = self.settings, self._random.standard_normal((len(self.particles), 3))
        spreads = np.array([s.way_noise, s.turn_per_way, s.turn_noise, s.rest_noise, s.rest_turn_noise])
        moved(self.particles, noise, step, max(time, 0.0), spreads)
        self._places = None

    def correct(self, beams: Floats, echoes: int) -> float:
        """Weigh the particles by a scan, and resample them if few of them count.

        Args:
            beams: (n, 4) end point, m, and direction, base frame; first those with an echo, then those without one,
                which end at the range of the sensor.
            echoes: Number of beams with an echo.

        Returns:
            Mean likelihood of one beam, 0 to 1: 1 if all end at mapped walls. 1 without particles or beams.
        """
        s, count = self.settings, len(self.particles)
        used, heard = self._some(beams, echoes)
        if not count or not len(used):
            return 1.0
        logs = np.empty(count)
        model = np.array([s.sigma, s.short, s.through, s.silent, s.gate, s.redundancy])
        log_likelihoods(self.field.values, self.field.frame, self.particles, used, heard, model, logs)
        self._places = None
        mean, effective = weighed(self.weights, logs)
        if effective < _EVEN * count:
            self._resample()
        likelihood_of_a_beam: float = math.exp(mean * s.redundancy / len(used))
        return likelihood_of_a_beam

    def hypotheses(self) -> Places:
        """The places where the robot may be, the likeliest first; none without particles."""
        if self._places is None:
            s = self.settings
            if not len(self.particles):
                return Places(np.empty((0, 3)), np.empty(0), np.empty((0, 3, 3)))
            bins, which = bins_of(self.particles, s.bin_size, s.bin_turns)
            self._places = clusters_of(self.particles, self.weights, bins, which, s.bin_turns, _MOST_PLACES)
        return self._places

    def covariance(self, pose: Floats) -> Floats:
        """(3, 3) mean square deviation of all particles from a pose (3,): honest also while several places remain."""
        found: Floats = moments(self.particles, self.weights, pose)
        return found

    def _drawn(self, poses: Floats, covariances: Floats, weights: Floats | None, count: int) -> Floats:
        share = np.full(len(poses), 1.0) if weights is None else np.asarray(weights, dtype=np.float64)
        which = resampled(share / share.sum(), self._random.random(), count)
        roots = np.array([_root(matrix) for matrix in np.broadcast_to(covariances, (len(poses), 3, 3))])
        noise = self._random.standard_normal((count, 3))
        # Without a matrix product, whose rounding depends on the processor.
        drawn: Floats = poses[which] + (roots[which] * noise[:, None, :]).sum(axis=2)
        drawn[:, 2] = np.remainder(drawn[:, 2] + math.pi, math.tau) - math.pi
        return drawn

    def _some(self, beams: Floats, echoes: int) -> tuple[Floats, int]:
        """About `beams` of the beams, others in each scan, and how many of them have an echo."""
        stride = max(1, len(beams) // self.settings.beams)
        self._part = (self._part + 1) % stride
        return np.ascontiguousarray(beams[self._part :: stride]), len(range(self._part, echoes, stride))

    def _resample(self, count: int | None = None) -> None:
        s = self.settings
        if count is None:
            _, which = bins_of(self.particles, s.bin_size, s.bin_turns)
            first = self._random.random()
            count = sample_size(self.weights, which, first, s.least, s.most, s.kld_error, s.kld_quantile)
            # Each place keeps half of the least: the weights of few particles drift apart by chance.
            places = int((self.hypotheses().weights > _LIKELY).sum())
            count = max(count, min(places * s.least // 2, s.most))
        self.particles = self.particles[resampled(self.weights, self._random.random(), count)]
        self.weights, self._places = np.full(count, 1.0 / count), None


def _root(matrix: Floats) -> Floats:
    """Lower triangular root of a covariance (3, 3), also of a singular one."""
    found = np.zeros((3, 3))
    for i in range(3):
        for k in range(i + 1):
            rest = float(matrix[i, k]) - sum(float(found[i, j] * found[k, j]) for j in range(k))
            if i == k:
                found[i, i] = math.sqrt(max(rest, 0.0))
            elif found[k, k] > 0.0:
                found[i, k] = rest / found[k, k]
    return found


def warm_up() -> None:
    """Compile the kernels."""
    sight.warm_up()
    sampling.warm_up()
    likelihood.warm_up()
    clusters.warm_up()
