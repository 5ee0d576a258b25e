"""The contract tier: what every plugin must pass. `navloom_check.checks` says how to add a check."""

from __future__ import annotations

from navloom_check.contract import (
    aligned,
    answers,
    attempts,
    centred,
    conduct,
    declared,
    drawn,
    lasting,
    later,
    maps,
    objects,
    order,
    parameters,
    platforms,
    references,
    repeats,
    schemes,
    sense,
    state,
    steering,
    surroundings,
    used,
    worded,
)

__all__ = ["CHECKS"]

CHECKS = (
    *declared.CHECKS,
    *worded.CHECKS,
    *answers.CHECKS,
    *sense.CHECKS,
    *centred.CHECKS,
    *maps.CHECKS,
    *surroundings.CHECKS,
    *platforms.CHECKS,
    *aligned.CHECKS,
    *attempts.CHECKS,
    *steering.CHECKS,
    *references.CHECKS,
    *order.CHECKS,
    *repeats.CHECKS,
    *state.CHECKS,
    *parameters.CHECKS,
    *used.CHECKS,
    *conduct.CHECKS,
    *lasting.CHECKS,
    *later.CHECKS,
    *objects.CHECKS,
    *schemes.CHECKS,
    *drawn.CHECKS,
)
"""Contract checks in running order: those without an object first, then those that say most about a broken plugin."""
