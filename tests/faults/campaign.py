"""The campaign: each fault many times at full speed. `python tests/faults/campaign.py --help`.

It writes a JSON file with every outcome, and prints the distributions as a table.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from fault_ends import ENDS, end_of_supervisor, name_of_end
from fault_kinds import PARTS, PROCESSES, SEIZED, SHADOWS, STRANGERS, STUCK, Fault, Outcome, inject
from fault_leftovers import DELETIONS, FORKS, WAYS
from fault_rig import Rig, rig
from resource_faults import FULL_DISK, RESOURCES, rig_on_small_disk, rig_with_clock, why_not

__all__ = ["main", "table"]

GROUPS: dict[str, Sequence[Fault]] = {
    "processes": PROCESSES,
    "parts": PARTS,
    "seized": SEIZED,
    "strangers": STRANGERS,
    "stuck": STUCK,
    "resources": RESOURCES,
    "forks": FORKS,
    "deletions": DELETIONS,
}
OWN = ("ends", "disks")
"""Groups in which each trial starts a new robot."""
COLUMNS: tuple[tuple[str, str, float], ...] = (
    ("ran_on", "ran on, ms", 1e3),
    ("gap", "gap, ms", 1e3),
    ("paused", "machine paused, ms", 1e3),
    ("zero", "zero, ms", 1e3),
    ("stood", "stood, ms", 1e3),
    ("left_driving", "left driving, s", 1.0),
    ("again", "again, s", 1.0),
)


class Book:
    """Outcomes, saved to a file as they come in."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.entries: list[dict[str, Any]] = json.loads(path.read_text("utf-8")) if path.exists() else []

    def add(self, outcome: Outcome) -> None:
        self.entries.append(outcome.to_json())
        self.path.write_text(json.dumps(self.entries, indent=1), "utf-8")
        told = {key: round(value, 3) for key, value in outcome.to_json().items() if isinstance(value, float)}
        print(f"{outcome.fault}: {told} {outcome.goal} {outcome.problem}", flush=True)

    def count(self, name: str) -> int:
        """Number of outcomes of a fault."""
        return sum(entry["fault"] == name for entry in self.entries)


def run(faults: Sequence[Fault], count: int, book: Book) -> None:
    """Inject the faults in turn until the book has `count` of each; after a problem, start a new robot."""
    while any(book.count(fault.name) < count for fault in faults):
        make = rig_with_clock if faults[0] in RESOURCES else Rig
        with rig(SHADOWS if faults[0] in STUCK else "", make) as robot:
            if not _turns(robot, faults, count, book):
                continue
            took = robot.end()
            left = robot.census.left()
            book.add(Outcome("navloom down", note={"ended_s": took, "code": robot.up.returncode, "left": left}))


def _turns(robot: Rig, faults: Sequence[Fault], count: int, book: Book) -> bool:
    while due := [fault for fault in faults if book.count(fault.name) < count]:
        for fault in due:
            try:
                book.add(inject(robot, fault))
            except AssertionError as error:
                notes = [f"{note.kind} {note.text}" for note in robot.driver.notes[-5:]]
                last = robot.log.read_text("utf-8")[-1500:]
                book.add(Outcome(fault.name, problem=f"{error}; driver: {notes}; up: {last}"))
                return False
    return True


def run_ends(count: int, book: Book) -> None:
    """Kill the supervisor, each time of a new robot."""
    kinds = [*((stopped, False, "") for stopped in ENDS), ("", True, ""), *(("", False, way) for way in WAYS)]
    while due := [kind for kind in kinds if book.count(name_of_end(*kind)) < count]:
        for kind in due:
            with rig() as robot:
                book.add(end_of_supervisor(robot, *kind))


def run_disks(count: int, book: Book) -> None:
    """Fill the disk, each time with a new robot: the process that records to it ends."""
    while due := [fault for fault in FULL_DISK if book.count(fault.name) < count]:
        for fault in due:
            with rig_on_small_disk() as robot:
                _turns(robot, [fault], book.count(fault.name) + 1, book)


def spread(values: Iterable[float | None], scale: float) -> str:
    """Minimum, median, 95th percentile and maximum."""
    known = sorted(value * scale for value in values if value is not None)
    if not known:
        return ""
    places = (0, len(known) // 2, min(len(known) - 1, len(known) * 95 // 100), -1)
    digits = 0 if scale > 1.0 else 2
    return " / ".join(f"{known[place]:.{digits}f}" for place in places)


def table(entries: Sequence[dict[str, Any]]) -> str:
    """Distribution of each fault, as a Markdown table; cells are minimum / median / 95th percentile / maximum."""
    heads = ["fault", "n", *(title for _, title, _ in COLUMNS), "goal kept", "contact"]
    lines = [" | ".join(heads), " | ".join("---" for _ in heads)]
    for name in dict.fromkeys(entry["fault"] for entry in entries):
        rows = [entry for entry in entries if entry["fault"] == name]
        good = [row for row in rows if not row["problem"]]
        cells = [spread((row.get(key) for row in good), scale) for key, _, scale in COLUMNS]
        kept = f"{sum(row['goal'] == 'kept' for row in good)} of {len(rows)}"
        lines.append(" | ".join([name, str(len(rows)), *cells, kept, str(sum(row["touched"] for row in rows))]))
    return "\n".join(f"| {line} |" for line in lines)


def main(arguments: Sequence[str] | None = None, say: Callable[[str], None] = print) -> list[dict[str, Any]]:
    """Run the groups that the arguments name; returns all outcomes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("groups", nargs="*", default=[*GROUPS, *OWN], help=f"of {', '.join((*GROUPS, *OWN))}")
    parser.add_argument("--count", type=int, default=20, help="of each fault")
    parser.add_argument("--only", default="", help="faults whose name has this in it")
    parser.add_argument("--out", type=Path, default=Path("faults.json"), help="file; what is in it counts")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # takes its robot down too
    book, began = Book(given.out), time.monotonic()
    for group in given.groups:
        if group in ("resources", "disks") and why_not():
            say(f"{group}: left out: {why_not()}")
        elif group in OWN:
            {"ends": run_ends, "disks": run_disks}[group](given.count, book)
        else:
            run([fault for fault in GROUPS[group] if given.only in fault.name], given.count, book)
    say(table(book.entries))
    say(f"{len(book.entries)} entries; {time.monotonic() - began:.0f} s")
    return book.entries


if __name__ == "__main__":
    main()
