"""The page of the documentation that `navloom bench --page` writes (docs/performance.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["page"]

HEAD = """\
# Performance

How fast this version of navloom (*ours*) is beside other software that does the same task (*theirs*), on one machine.
[bench.md](bench.md) explains the entries. *Times as fast* is the median over the rounds of theirs / ours, with its
quartiles; below 1, ours is slower. It varies less than the durations, which depend on the machine and its load.
[measurements.md](lab/measurements.md) has what this command cannot measure: earlier versions, live robots, and
comparisons that need other software. `navloom bench --page docs/performance.md` makes this page; do not edit it by
hand.
"""
COLUMNS = ("measured", "ours", "theirs", "unit", "times as fast", "quartiles", "compared with")


def page(found: Mapping[str, Any], date: str) -> str:
    """The page, Markdown.

    Args:
        found: Return value of `measuring.bench`.
        date: Date of the measurement, as 2026-11-23.
    """
    at = found["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in at["versions"].items())
    facts = [
        ("date", date),
        ("processor", f"{at['cpu']}, {at['cpus']} CPUs"),
        ("load at the end", f"{at['load']}"),
        ("Python", at["python"]),
        ("versions", versions),
    ]
    parts = [HEAD, _table(("measured on", ""), facts), _table(COLUMNS, [_entries(row) for row in found["rows"]])]
    if found["quick"]:
        parts.insert(
            1, "**Made with `--quick`: these figures show that the command works, not how fast anything is.**\n"
        )
    notes = {row["note"]: row["name"] for row in reversed(found["rows"]) if row["note"]}
    parts += [f"- {name}: {note}\n" for note, name in reversed(notes.items())]
    parts += [f"- Left out: {name}: {why}\n" for name, why in found["left_out"].items()]
    return "\n".join(parts[: 3 + found["quick"]]) + "\n" + "".join(parts[3 + found["quick"] :])


def _entries(row: Mapping[str, Any]) -> tuple[str, ...]:
    spread = "" if row["low"] is None else f"{row['low']:.3g} to {row['high']:.3g}"
    theirs, ratio = ("" if row[key] is None else f"{row[key]:.4g}" for key in ("theirs", "ratio"))
    return row["name"], f"{row['ours']:.4g}", theirs, row["unit"], ratio, spread, row["peer"]


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
