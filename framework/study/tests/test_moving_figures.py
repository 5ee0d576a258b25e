"""Pictures of worlds in which something moves."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from navloom.geometry.actors import Actor, Body, Course
from navloom.geometry.world import World
from navloom_study.report.extent import extent_of
from navloom_study.report.plan_view import outline_of_part
from navloom_study.report.track_figures import draw_world

WORLD = World("w", actors=(Actor("p", Course(((0.0, 1.0, 0.0), (4.0, 3.0, 0.0))), Body("disc", 0.5, 0.5)),))


def test_a_world_shows_where_its_actors_begin_and_their_ways() -> None:
    _, axes = plt.subplots()
    draw_world(axes, WORLD, 0.6)
    lines = [path.vertices for drawn in axes.collections for path in drawn.get_paths()]
    assert any(len(line) == 2 and np.allclose(line, [(1.0, 0.0), (3.0, 0.0)]) for line in lines)
    assert any(len(line) > 30 and np.allclose(line.mean(axis=0), (1.0, 0.0), atol=0.02) for line in lines)


def test_the_extent_holds_the_ways_of_actors() -> None:
    assert extent_of(np.array([(0.0, 0.0)]), WORLD, 0.5)[2] == 3.25 + 0.3


def test_the_outline_of_a_part_is_a_box_or_a_circle() -> None:
    box = outline_of_part((0.0, 1.0, 2.0, 0.5, 0.25, 0.0, 0.0, 1.0, 0.0))
    assert sorted(map(tuple, box.tolist())) == [(0.5, 1.75), (0.5, 2.25), (1.5, 1.75), (1.5, 2.25)]
    circle = outline_of_part((0.0, 1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0))
    assert np.allclose(np.hypot(*(circle - (1.0, 2.0)).T), 0.5)
