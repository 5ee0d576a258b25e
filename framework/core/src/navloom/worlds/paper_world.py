"""The world of the experiment of Hoang et al. 2013, Figs. 8 to 11: two gates under girders, and a corridor.

Gate A (x -1.4..1.0) is closed by a girder below the robot's top, gate B (x 1.4..3.8) is open below a higher girder,
corridor C (x 4.2..6.8) runs along the right wall. The available text of the paper lacks the figures; the sizes are our
choice, such that the printed route results and each of the 9,494 rays returns a pixel.
"""

from __future__ import annotations

import math

from navloom.geometry.world import Box, Obstacle, Place, World

__all__ = [
    "paper_gates",
    "paper_gates_blocked_b",
    "paper_gates_blocked_bc",
    "paper_gates_obstacle",
    "paper_gates_open_a",
]

_GIRDER_A = Box("girder A", (-1.4, 1.0), (5.2, 5.4), (0.90, 1.10))
_OBSTACLES = (
    Box("back wall", (-4.6, 7.2), (9.2, 9.4)),
    Box("left wall", (-4.4, -4.2), (-1.0, 9.4)),
    Box("right wall", (6.8, 7.0), (-1.0, 9.4)),
    Box("gate wall left", (-4.4, -1.4), (5.2, 5.4)),
    _GIRDER_A,
    Box("post A/B", (1.0, 1.4), (5.2, 5.4)),
    Box("girder B", (1.4, 3.8), (5.2, 5.4), (1.40, 1.60)),
    Box("partition", (3.8, 4.2), (5.2, 6.8)),
    # Without a ceiling, 1,801 of the 9,494 rays pass over the walls and return nothing: the paper counts 9,494 pixels.
    Box("ceiling", (-4.4, 7.0), (-1.0, 9.4), (2.4, 2.5)),
)
_BARRIER_B = Box("barrier B", (2.1, 3.1), (5.2, 5.4))
_DOOR_C = Box("door C", (4.2, 6.8), (5.2, 5.4))
_OBSTACLE_O = Box("obstacle O", (1.05, 1.35), (2.45, 2.75), (0.0, 0.5), appears_after_sweep=True)


def _gates(name: str, obstacles: tuple[Obstacle, ...]) -> World:
    return World(
        name,
        obstacles,
        start=Place(0.0, 0.0, 0.5 * math.pi),
        goal=Place(0.0, 7.6),
        bounds=(-4.6, -2.0, 7.2, 9.6),
    )


def paper_gates() -> World:
    """The world as described: the shortest path leads through gate B."""
    return _gates("paper_gates", _OBSTACLES)


def paper_gates_open_a() -> World:
    """Without girder A: the shortest path leads straight through gate A."""
    return _gates("paper_gates_open_a", tuple(o for o in _OBSTACLES if o is not _GIRDER_A))


def paper_gates_blocked_b() -> World:
    """A barrier in the middle of gate B leaves 0.7 m on either side, too little for the robot: only corridor C is free.

    A wider barrier would hide the side of the partition behind it from the laser. With the gate closed from post to
    partition, the map lacks that side, and the planned path is 0.7 m shorter than the room allows.
    """
    return _gates("paper_gates_blocked_b", (*_OBSTACLES, _BARRIER_B))


def paper_gates_blocked_bc() -> World:
    """A door closes corridor C as well: there is no path."""
    return _gates("paper_gates_blocked_bc", (*_OBSTACLES, _BARRIER_B, _DOOR_C))


def paper_gates_obstacle() -> World:
    """With the obstacle of Fig. 11, which appears on the path to gate B after the sweep: 135 rays would meet it."""
    return _gates("paper_gates_obstacle", (*_OBSTACLES, _OBSTACLE_O))
