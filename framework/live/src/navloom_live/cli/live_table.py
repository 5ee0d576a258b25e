"""Output of `navloom up` while a robot is up: a table that is redrawn on a terminal, otherwise log lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import IO, Any

from navloom.cli.output import paced
from navloom.cli.run_summary import print_summary

__all__ = ["StatusTable"]

REDRAW = 0.25


class StatusTable:
    """Status of a live run on a terminal.

    Args:
        run: The `LiveRun`.
        stream: Stream that it is written to.
        say: Prints a line that stays.
    """

    def __init__(self, run: Any, stream: IO[str], say: Callable[[str], None]) -> None:
        self._run, self._stream, self.say = run, stream, say
        self._live: Any = None
        self._drawn = 0.0
        self._told = ""
        self._waits: Callable[[str], None] | None = None

    def __enter__(self) -> StatusTable:
        if self._stream.isatty():
            from rich.console import Console
            from rich.live import Live

            self._live = Live(console=Console(file=self._stream), auto_refresh=False, transient=True)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def missing(self, left: Sequence[tuple[str, str]], total: int, kernels: Any) -> None:
        """Show how many nodes are up, which are not yet, and which kernel compiles if any does."""
        compiles = f", {kernels}" if kernels.compiled else ""
        names = ", ".join(f"{role} {name}" for role, name in left)
        text = f"{total - len(left)} of {total} nodes are up{compiles}; waiting for {names}"
        if self._live is not None:
            self._live.update(text, refresh=True)
        elif self._waits is None:
            self._waits = paced(self.say)
            self.say("starting; the first run compiles kernels, later ones load them")
        else:
            self._waits(text)

    def look(self, robot: Any) -> None:
        """Redraw the table if it is due."""
        now = time.monotonic()
        if self._live is None:
            self._tell_changes()
        elif now - self._drawn > REDRAW:
            self._drawn = now
            self._live.update(self._table(robot), refresh=True)

    def result(self, episode: Any) -> None:
        """Print the result of a goal."""
        if self._live is not None:
            self._live.update("", refresh=True)
        if self._run.judges:
            print_summary(episode, episode.summary())
        else:
            self.say(
                f"{episode.result.outcome}: {episode.result.reason}; by the robot's own report, without ground truth"
            )

    def _tell_changes(self) -> None:
        feedback = self._run.feedback
        parts = [f"goal {feedback.goal_id}: {feedback.state}"] if feedback is not None and feedback.goal_id else []
        text = "; ".join(part for part in (*parts, self._driver()[0]) if part)
        if text and text != self._told:
            self._told = text
            self.say(text)

    def _driver(self) -> tuple[str, bool]:
        """The source that drives, or why the robot is stopped (empty if the goal says it); whether that is a fault."""
        from navloom.navigation.status_words import NO_GOAL, has_no_path, who_drives

        feedback, status = self._run.feedback or NO_GOAL, self._run.status
        if status is None:
            return "", False
        if not has_no_path(status):
            return who_drives(status), status.stopped
        return "" if feedback.goal_id else who_drives(status, feedback, self._run.result), False

    def _table(self, robot: Any) -> Any:
        from navloom.navigation.status_words import progress
        from rich.console import Group
        from rich.table import Table
        from rich.text import Text

        from navloom_live.operating.shadow_report import COLUMNS, cells_of

        feedback = self._run.feedback
        head = Text(f"{robot.keys.prefix}  ")
        if feedback is not None and feedback.goal_id:
            head.append(f"goal {feedback.goal_id}: {progress(feedback)}  ")
        text, is_wrong = self._driver()
        head.append(text, "bold red" if is_wrong else "")
        table = Table("process", "pid", "state", "restarts", "nodes", box=None, pad_edge=False)
        gone = set(robot.missing())
        for name, child in robot.supervisor.children.items():
            pid = str(child.process.pid) if child.process is not None else "-"
            nodes = ", ".join(
                f"{role}{' (gone)' if (role, instance) in gone else ''}"
                for role, instance in child.task.given.get("share", {}).get("sources", ())
            )
            table.add_row(name, pid, child.state, str(child.restarts), nodes)
        shadows = self._run.shadows
        if not shadows:
            return Group(head, table)
        compared = Table(*COLUMNS, box=None, pad_edge=False)
        for shadow in shadows:
            compared.add_row(*cells_of(shadow))
        return Group(head, table, compared)
