"""Colours with the same meaning in every view: those of Okabe and Ito, which suit any colour vision."""

from __future__ import annotations

from navloom.palette import OKABE_ITO

__all__ = [
    "ACTOR",
    "BLOCKED",
    "CLOUD",
    "DRIVEN",
    "FREE",
    "GREEN",
    "GREY",
    "PLAN",
    "PURPLE",
    "STATES",
    "TRAJECTORY",
    "WHITE",
    "faded",
]

Colour = tuple[int, int, int, int]
"""Red, green, blue and opacity, 0 to 255."""


def _rgb(text: str) -> Colour:
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16), 255


BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = (_rgb(text) for text in OKABE_ITO[:6])
YELLOW = _rgb(OKABE_ITO[7])
WHITE: Colour = (255, 255, 255, 255)
GREY: Colour = (150, 150, 150, 255)

ACTOR: tuple[Colour, ...] = (SKY, ORANGE, GREEN, PURPLE, YELLOW, VERMILION, BLUE)
"""Colours of methods and shadows in the order of their names; those that are legible on black come first."""
PLAN, TRAJECTORY, DRIVEN = ORANGE, BLUE, VERMILION
"""Lines of a single robot, the same as in the picture that `run --out` writes."""
BLOCKED, FREE = VERMILION, GREEN
"""Sectors of a polar histogram."""
CLOUD: dict[str, Colour] = {
    "kept": (213, 60, 0, 255),
    "behind": (240, 190, 130, 255),
    "floor": (120, 130, 140, 255),
    "overhead": SKY,
    "below": PURPLE,
}
"""Colours of a sweep's points by their class."""
STATES: dict[str, Colour] = {
    "idle": (90, 90, 90, 255),
    "mapping": SKY,
    "planning": YELLOW,
    "driving": GREEN,
    "recovering": PURPLE,
    "waiting": ORANGE,
    "searching": VERMILION,
    "controller": GREEN,
    "avoider": ORANGE,
    "recovery": PURPLE,
    "operator": SKY,
    "braking": YELLOW,
    "stopped": VERMILION,
    "standing": (90, 90, 90, 255),
    "clear": GREEN,
    "steering": ORANGE,
    "trapped": VERMILION,
}
"""Colours of states in the state timeline."""


def faded(colour: Colour, share: float) -> Colour:
    """The colour with an opacity of `share`."""
    return colour[0], colour[1], colour[2], round(255 * share)
