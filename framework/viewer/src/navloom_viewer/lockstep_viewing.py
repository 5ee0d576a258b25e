"""Shows a lockstep run of one config in a viewer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from navloom.config import Loaded
from navloom.engine.build import assemble
from navloom.messages import Envelope, Message, StepRecord

from navloom_viewer.drawing import Shown
from navloom_viewer.picture_setup import facts_of
from navloom_viewer.viewer_session import Showing, Where, showing

__all__ = ["Gathering", "Watch", "watch_fleet", "watch_run"]

WORLD = frozenset({"world"})
"""Role of the node that moves people and robots."""


class Gathering:
    """An observer that costs only a list append in the tick; `drain` passes the collected messages on.

    Args:
        variant: Name of the run in the picture.
        take: Called with every message, in order, by `drain`.
        left_out: Roles whose messages are not shown.
    """

    wants: frozenset[tuple[str, str]] | None = None
    wants_steps = False

    def __init__(self, variant: str, take: Callable[[Shown], None], left_out: frozenset[str] = frozenset()) -> None:
        self.variant, self.take, self._left_out = variant, take, left_out
        self._kept: list[Shown] = []

    def on_message(self, role: str, instance: str, active: bool, port: str, message: Message, at: Envelope) -> None:
        """Store a message; messages are immutable."""
        if role not in self._left_out:
            self._kept.append(Shown(self.variant, role, instance, active, port, message, at.tick, at.stamp_ns))

    def on_step(self, record: StepRecord) -> None:
        """Never called: `wants_steps` is false."""

    def drain(self) -> None:
        """Pass the collected messages on. Call it between ticks, so that it does not count as part of one."""
        kept, self._kept = self._kept, []
        for shown in kept:
            self.take(shown)


Progress = Callable[[float, float], None]


@dataclass(eq=False)
class Watch:
    """The viewer's observers of one run.

    Attributes:
        observers: Observers for the run.
        showing: The showing.
    """

    observers: Sequence[Gathering]
    showing: Showing

    def between(self, progress: Progress) -> Progress:
        """A progress function that also passes the collected messages on between ticks."""

        def tell(done: float, total: float) -> None:
            self.drain()
            progress(done, total)

        return tell

    def finish(self) -> None:
        """Pass on the remaining messages and draw them, after the run."""
        self.drain()
        self.showing.finish()

    def drain(self) -> None:
        """Pass on the collected messages."""
        for observer in self.observers:
            observer.drain()


@contextmanager
def watch_run(loaded: Loaded, where: Where, say: Callable[[str], None]) -> Iterator[Watch]:
    """Show a run of a config. The trace does not change.

    Args:
        loaded: The config.
        where: Where to show it.
        say: Receives messages for the user.

    Raises:
        ViewerError: It cannot be shown there.
    """
    with _watch([loaded], f"{loaded.name}, seed {loaded.config.run.seed}", where, say) as watch:
        yield watch


@contextmanager
def watch_fleet(members: Sequence[Loaded], where: Where, say: Callable[[str], None]) -> Iterator[Watch]:
    """Show the members of a fleet in one picture, an observer each in their order; see `watch_run`."""
    with _watch(members, members[0].name.partition(": member ")[0], where, say) as watch:
        yield watch


@contextmanager
def _watch(robots: Sequence[Loaded], title: str, where: Where, say: Callable[[str], None]) -> Iterator[Watch]:
    facts = facts_of({one.config.robot.name: assemble(one) for one in robots}, title)
    blocked = frozenset(robots[0].config.plugins.blocked)
    with showing(facts, where, recording_id=robots[0].sha256(), blocked=blocked, say=say) as shown:
        # What moves is the same for all: one of them draws it.
        watch = Watch(
            [
                Gathering(one.config.robot.name, shown.bridge.put_all, WORLD if number else frozenset())
                for number, one in enumerate(robots)
            ],
            shown,
        )
        try:
            yield watch
        finally:
            watch.drain()
