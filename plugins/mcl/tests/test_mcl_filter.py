"""The particle filter: motion, evidence, hypotheses and covariance, against numbers that can be checked by hand."""

import math

import numpy as np
import pytest
from navloom_mcl import filter as particle_filter
from navloom_mcl.filter import FilterSettings, ParticleFilter
from navloom_mcl.likelihood import log_likelihoods
from navloom_scans.field import distance_field
from scan_localizer_rooms import beams_of, fan, ranges_in, room

CELL = 0.05
SEEN = fan(361)
HALL = room(80, 120)
"""A hall of 6 m x 4 m: turned by half a turn, it looks the same."""
FIELD = distance_field(HALL, CELL, (0.0, 0.0, 0.0), 1.0)
QUIET = {"way_noise": 0.0, "turn_per_way": 0.0, "turn_noise": 0.0, "rest_noise": 0.0, "rest_turn_noise": 0.0}


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    particle_filter.warm_up()


def filter_of(seed=0, **settings):
    return ParticleFilter(FIELD, FilterSettings(**settings), np.random.default_rng(seed))


def beams_at(place, walls=HALL):
    beams = beams_of(ranges_in(walls, CELL, place, SEEN), SEEN)
    return beams, len(beams)


def other(place):
    """The pose in the hall that sees the same."""
    return np.array([6.0 - place[0], 4.0 - place[1], math.remainder(place[2] + math.pi, math.tau)])


def test_a_drive_spreads_the_particles_as_the_parameters_say():
    particles = filter_of(**{**QUIET, "way_noise": 0.05, "turn_per_way": math.radians(3.0)})
    particles.spread(np.array([[1.0, 1.0, math.pi / 2]]), np.zeros((3, 3)), count=40_000)
    particles.predict(np.array([1.0, 0.0, 0.5]), 1.0)
    x, y, heading = particles.particles.T
    # One metre towards +y: along 0.05 m, heading 3 deg, across the root of 0.025² and (0.5 x 0.0524)².
    assert (x.mean(), y.mean(), heading.mean()) == pytest.approx((1.0, 2.0, math.pi / 2 + 0.5), abs=2e-3)
    assert (y.std(), math.degrees(heading.std())) == pytest.approx((0.05, 3.0), rel=0.02)
    assert x.std() == pytest.approx(0.0362, rel=0.02)


def test_the_spread_of_a_drive_does_not_depend_on_its_steps():
    spreads = []
    for steps in (1, 20):
        particles = filter_of(**{**QUIET, "way_noise": 0.05, "turn_noise": math.radians(3.0)})
        particles.spread(np.array([[0.0, 0.0, 0.0]]), np.zeros((3, 3)), count=20_000)
        for _ in range(steps):
            particles.predict(np.array([1.0, 0.0, 0.0]) / steps, 1.0 / steps)
        spreads.append(particles.particles.std(axis=0))
    assert spreads[1] == pytest.approx(spreads[0], rel=0.03)


def test_headings_stay_within_half_a_turn():
    particles = filter_of(**QUIET)
    particles.spread(np.array([[0.0, 0.0, 3.0]]), np.zeros((3, 3)), count=10)
    particles.predict(np.array([0.0, 0.0, 0.5]), 0.1)
    assert particles.particles[:, 2] == pytest.approx(np.full(10, 3.5 - math.tau))


def test_a_spread_has_the_given_moments_and_shares():
    particles = filter_of()
    matrix = np.array([[0.04, 0.02, 0.0], [0.02, 0.05, 0.003], [0.0, 0.003, 0.01]])
    particles.spread(np.array([[1.0, 1.0, 0.2], [5.0, 1.0, 0.2]]), matrix, np.array([3.0, 1.0]), 40_000)
    left = particles.particles[particles.particles[:, 0] < 3.0]
    assert len(left) == 30_000
    assert np.cov(left.T) == pytest.approx(matrix, abs=2e-3)


def kinds(beam, pose, walls, echoes=1):
    """Log likelihood of one beam, of a model with whole numbers as its logarithms."""
    model = np.array([0.1, math.exp(-1.0), math.exp(-3.0), math.exp(-2.0), 0.24, 1.0])
    field, found = distance_field(walls, CELL, (0.0, 0.0, 0.0), 1.0), np.empty(1)
    log_likelihoods(field.values, field.frame, np.array([pose]), np.array([beam]), echoes, model, found)
    return float(found[0])


def test_an_occluded_beam_costs_less_than_one_through_a_wall():
    walls = room(80, 120)
    walls[:, 60:62] = True
    at = (1.0, 2.0, 0.0)
    # The wall is 2 m ahead: a hit; 0.5 m: something unmapped; 2.5 m: through it; nothing within 3 m: through it too.
    hit, occluded, through = (kinds([way, 0.0, 1.0, 0.0], at, walls) for way in (2.0, 0.5, 2.5))
    assert (hit, through) == pytest.approx((0.0, -3.0), abs=1e-3)
    assert occluded == pytest.approx(-1.0, abs=1e-3)
    assert kinds([3.0, 0.0, 1.0, 0.0], at, walls, 0) == pytest.approx(-2.0)
    assert kinds([1.0, 0.0, 1.0, 0.0], at, walls, 0) == 0.0


def test_a_scan_moves_the_particles_to_where_it_fits():
    particles, place = filter_of(**QUIET), (2.0, 1.5, 0.4)
    particles.spread(np.array([[2.2, 1.4, 0.3]]), np.diag([0.04, 0.04, 0.02]))
    for _ in range(3):
        likelihood = particles.correct(*beams_at(place))
    found = particles.hypotheses()
    assert math.dist(found.poses[0, :2], place[:2]) < 0.03
    assert abs(found.poses[0, 2] - place[2]) < math.radians(1.0)
    assert likelihood > 0.9


def test_a_hall_that_looks_the_same_from_both_sides_keeps_two_hypotheses():
    weights = []
    for seed in range(10):
        particles, place = filter_of(seed), np.array([2.0, 1.5, 0.4])
        particles.spread(np.array([place, other(place)]), np.diag([0.01, 0.01, 0.003]))
        for _ in range(5):
            particles.predict(np.array([0.1, 0.0, 0.0]), 0.2)
            place = place + [0.1 * math.cos(0.4), 0.1 * math.sin(0.4), 0.0]
            particles.correct(*beams_at(place))
        found = particles.hypotheses()
        first = min(range(2), key=lambda k: math.dist(found.poses[k, :2], place[:2]))
        assert math.dist(found.poses[first, :2], place[:2]) < 0.05
        assert math.dist(found.poses[1 - first, :2], other(place)[:2]) < 0.05
        assert found.weights[:2].sum() > 0.99
        weights.append(found.weights[first])
    # One run drifts by chance; ten show that neither place is preferred.
    assert np.mean(weights) == pytest.approx(0.5, abs=0.1)
    assert min(weights) > 0.2


def test_the_covariance_spans_all_places():
    particles = filter_of()
    poses = np.array([[1.0, 2.0, 0.0], [5.0, 2.0, math.pi]])
    particles.spread(poses, np.diag([1e-4, 1e-4, 1e-4]), np.array([3.0, 1.0]))
    found = particles.hypotheses()
    assert found.weights == pytest.approx([0.75, 0.25])
    # From the first place, a quarter of the particles is 4 m and half a turn away.
    covariance = particles.covariance(found.poses[0])
    assert covariance[0, 0] == pytest.approx(0.25 * 16.0, rel=0.02)
    assert covariance[2, 2] == pytest.approx(0.25 * math.pi**2, rel=0.02)
    assert found.covariances[0][0, 0] < 2e-4


def test_places_that_touch_are_one():
    particles = filter_of()
    line = np.column_stack((np.linspace(1.0, 5.0, 50), np.full(50, 2.0), np.zeros(50)))
    particles.spread(line, np.diag([1e-4, 1e-4, 1e-4]))
    assert len(particles.hypotheses().poses) == 1


def test_the_number_of_particles_falls_as_the_belief_narrows():
    particles, place = filter_of(least=300, most=4000), (2.0, 1.5, 0.4)
    particles.spread(np.array([[2.5, 1.5, 0.4]]), np.diag([0.5, 0.5, 0.3]))
    assert len(particles.particles) == 4000
    for _ in range(6):
        particles.predict(np.zeros(3), 0.05)
        particles.correct(*beams_at(place))
    assert 300 <= len(particles.particles) < 700


def test_injected_places_get_their_share():
    particles = filter_of(least=300, most=1000)
    particles.spread(np.array([[1.0, 1.0, 0.0]]), np.diag([1e-3, 1e-3, 1e-3]))
    particles.inject(
        np.array([[5.0, 3.0, 1.0], [3.0, 3.0, 1.0]]), np.diag([1e-3, 1e-3, 1e-3]), np.array([3.0, 1.0]), 0.2
    )
    assert particles.hypotheses().weights == pytest.approx([0.8, 0.15, 0.05])
    assert len(particles.particles) == 1000
    assert particles.weights.sum() == pytest.approx(1.0)


def test_evidence_that_nothing_explains_leaves_numbers():
    particles = filter_of()
    assert particles.correct(np.empty((0, 4)), 0) == 1.0
    particles.spread(np.array([[100.0, 100.0, 0.0]]), np.diag([1e-3, 1e-3, 1e-3]))
    particles.correct(*beams_at((2.0, 1.5, 0.4)))
    assert np.isfinite(particles.weights).all()
    assert particles.weights.sum() == pytest.approx(1.0)
    particles.clear()
    assert particles.hypotheses().poses.shape == (0, 3)


def test_the_same_seed_gives_the_same_particles():
    runs = []
    for _ in range(2):
        particles = filter_of(7)
        particles.spread(np.array([[2.0, 1.5, 0.4]]), np.diag([0.04, 0.04, 0.02]))
        for _ in range(5):
            particles.predict(np.array([0.01, 0.0, 0.0]), 0.05)
            particles.correct(*beams_at((2.0, 1.5, 0.4)))
        runs.append(particles.particles.tobytes() + particles.weights.tobytes())
    assert runs[0] == runs[1]
