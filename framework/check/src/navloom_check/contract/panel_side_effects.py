"""What a panel does besides drawing: output, logging of its own, and drawings that grow."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import pairwise
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
from navloom.geometry.footprints import rectangle
from navloom.messages import SCHEMAS, Message, Pose2D
from navloom.parts import part
from numpy.typing import NDArray

from navloom_check.captured_output import PRINTED
from navloom_check.check_bench import Bench
from navloom_check.checks import check
from navloom_check.findings import Finding, NotRun
from navloom_check.samples import sample
from navloom_check.shifted_inputs import restamped
from navloom_check.side_effects import GUARD

__all__ = ["CHECKS", "views"]

DRAWINGS = 40
"""Drawings of the same message; a panel that keeps a short tail of what it drew stops growing earlier."""


@check("contract", {"panel"}, "It draws the same message again without drawing more each time, prints nothing, and "
       "leaves logging to the viewer.")  # fmt: skip
def panel_only_draws(bench: Bench) -> Iterator[Finding]:
    """The viewer logs what a panel yields, at the time and under the robot that belong to it."""
    view = views()
    panel = bench.subject.thing
    cls = next((schema for schema in SCHEMAS.values() if issubclass(schema, panel.message)), panel.message)
    seen = view(Pose2D(1.0, 2.0, 0.5), np.array([[0.0, 1.0, 2.0, 0.5]]))
    given = sample(cls, np.random.default_rng(bench.seed))
    PRINTED.news()
    sizes = [_drawn(panel, given, seen)]
    viewer = sys.modules.get("rerun") or SimpleNamespace(log=None)  # the panel has imported it by now, if it uses it
    with patch.object(viewer, "log") as log:
        sizes += [_drawn(panel, given, seen) for _ in range(DRAWINGS - 1)]
    if log.called:
        yield Finding("calls rerun.log", "yield (entity path, archetype): the viewer logs it", given=cls.__name__)
    paths = [_paths(panel, restamped(given, 0.1 * number), seen) for number in range(DRAWINGS)]
    if all(after - before for before, after in pairwise(paths)) and len(set().union(*paths)) >= DRAWINGS:
        yield Finding(
            f"draws each message at another entity path, such as {min(paths[-1])!r}", "the same paths for each message "
            "of a stream: the viewer keeps all paths", given=f"{cls.__name__}, {DRAWINGS} times",
        )  # fmt: skip
    if text := PRINTED.news().strip():
        yield Finding(f"prints {text.splitlines()[0][:80]!r}", "logging.getLogger(__name__); no print()",
                      given=cls.__name__)  # fmt: skip
    if all(after > before for before, after in pairwise(sizes)):
        yield Finding(
            f"draws {sizes[0]} things for a message, and {sizes[-1]} for the same message after {DRAWINGS} drawings",
            "a drawing of the message alone: seen.track has the way that the robot drove", given=cls.__name__,
        )  # fmt: skip


def views() -> Callable[[Pose2D | None, NDArray[np.float64]], Any]:
    """Makes what a panel sees of a robot, a `Seen`, from its pose and its track, (n, 4) time, s, x, y, m, heading, rad.

    Raises:
        NotRun: The viewer is not installed, without which a panel cannot draw.
    """
    try:
        import_module("rerun")
        panels, setup = part("navloom_viewer.panels"), part("navloom_viewer.picture_setup")
    except ImportError:
        raise NotRun("it draws with the viewer, which is not installed: pip install 'navloom[view]'") from None
    robot = setup.Variant("robot", rectangle(0.5, 0.4), 1.0, Pose2D(0.0, 0.0, 0.0), None)
    actor = setup.Actor("robot", "robot", (0, 0, 0, 255), False)
    return lambda pose, track: panels.Seen(actor, robot, "robot", "main", "port", pose, track, True, 1.0)


def _drawn(panel: Any, given: Message, seen: Any) -> int:
    """Number of things that a panel draws for a message."""
    try:
        with GUARD.within("the panel"):
            return sum(map(_instances, panel.to_rerun(given, seen)))
    except Exception as error:
        raise NotRun(f"it raises {type(error).__name__}: see the check `panel_draws`") from None


def _paths(panel: Any, given: Message, seen: Any) -> frozenset[str]:
    """Entity paths that a panel draws a message at."""
    with GUARD.within("the panel"):
        return frozenset(str(one[0]) for one in panel.to_rerun(given, seen) if isinstance(one, tuple))


def _instances(drawn: Any) -> int:
    """Number of things, such as points, in one drawing."""
    batches = drawn[1].as_component_batches() if isinstance(drawn, tuple) and len(drawn) == 2 else ()
    return sum(len(batch.as_arrow_array()) for batch in batches)


CHECKS = (panel_only_draws,)
