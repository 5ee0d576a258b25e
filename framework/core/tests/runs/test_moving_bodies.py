"""Radii of what moves in the ground truth."""

from __future__ import annotations

import numpy as np
import pytest
from navloom.geometry.actors import Actor, Body, Course
from navloom.geometry.moving_world import MovingWorld
from navloom.geometry.world import World
from navloom.runs.moving_bodies import moving_bodies


@pytest.mark.parametrize(
    ("body", "radius"),
    [
        (Body("legs", 0.44, 0.44, (0.0, 1.75)), 0.22),  # the feet are up to 0.39 m off
        (Body("disc", 0.5, 0.5), 0.25),
        (Body("box", 0.6, 0.8), 0.5),
        (Body("trolley", 0.6, 0.8), 0.5),
    ],
)
def test_the_radius_of_a_body_is_that_of_its_definition(body: Body, radius: float) -> None:
    world = World("one", actors=(Actor("a", Course(((0.0, 0.0, 0.0), (4.0, 4.0, 0.0))), body),))
    moved = MovingWorld(world, [], 0.05)
    said = [moved.advance(round(1e9 * time), []) for time in (0.0, 0.1, 0.3, 0.9)]
    assert body.radius == pytest.approx(radius)
    assert moving_bodies(said, np.array([0.0, 0.1, 0.3, 0.9])).radii.tolist() == pytest.approx([radius])
