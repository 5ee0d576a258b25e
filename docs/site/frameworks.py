"""Writes docs/frameworks.md from frameworks.toml: `python docs/site/frameworks.py`; `--stale` warns of old cells.

`--stale` prints one line for each framework that has cells older than `FRESH`, and exits 0. Read these sources again,
and write what they say and the date into frameworks.toml. `--today DATE` counts from another day.
"""

from __future__ import annotations

import argparse
import datetime
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "frameworks.md"
FRESH = 90
"""Days after which a cell is to be looked at again."""
SIGNS = {"Yes": "●", "Partly": "◐", "No": "○"}
"""Sign of an answer in the overview; a subject that is no question is not in it."""
HEAD = """# navloom beside other frameworks

<!-- python docs/site/frameworks.py writes this page from docs/site/frameworks.toml -->

What each framework says of itself, in its documentation or its repository. Behind each statement stands the date on
which we read it; the date links to what we read, or to the repository if that was the package which it publishes. A
dash means that we searched and found nothing, which does not prove that there is nothing. If a statement about
your framework is wrong, correct it in `docs/site/frameworks.toml`.

If you need production maturity, 3D navigation, SLAM, fleets or ready-made drivers today, choose one of the others.
navloom is for comparing methods: it repeats runs bit for bit, runs methods in shadow on the same inputs, and its
studies give confidence intervals.

## Overview

● yes, ◐ partly, ○ no, – nothing found. The sections below say what lies behind each sign.
"""


def load(path: Path = HERE / "frameworks.toml") -> dict[str, Any]:
    """The statements."""
    return tomllib.loads(path.read_text("utf-8"))


def url_of(source: str, data: dict[str, Any]) -> str:
    """The link of a source: of this project and of other sites as it is; KEY@COMMIT:PATH in a repository."""
    key, at, rest = source.partition("@")
    if not at or "/" in key:
        return source
    commit, _, path = rest.partition(":")
    home = data["repositories"].get(key) or data["frameworks"][key][1]
    return f"{home}/blob/{commit}/{path}"


def answer(cell: list[Any] | None) -> str | None:
    """The sign of a cell; None where the subject is no question."""
    return "–" if cell is None else SIGNS.get(cell[0].partition(":")[0])


def cells(subject: dict[str, Any], data: dict[str, Any]) -> dict[str, list[Any] | None]:
    """The cells of a subject, by framework."""
    return {key: subject.get(key) for key in data["frameworks"]}


def overview(data: dict[str, Any]) -> Iterator[str]:
    """Every question with the signs of all frameworks."""
    names = [name for name, _, _ in data["frameworks"].values()]
    yield f"| | {' | '.join(names)} |"
    yield f"|---|{':---:|' * len(names)}"
    for subject in data["subject"]:
        signs = [answer(cell) for cell in cells(subject, data).values()]
        if None not in signs:
            name = subject["name"]
            yield f"| [{name}](#{name.lower().replace(' ', '-')}) | {' | '.join(map(str, signs))} |"


def section(subject: dict[str, Any], data: dict[str, Any]) -> Iterator[str]:
    """What each framework says of one subject, and in which nothing was found."""
    yield f"### {subject['name']}\n"
    yield "| framework | what it says |"
    yield "|---|---|"
    missing = []
    for key, cell in cells(subject, data).items():
        name = data["frameworks"][key][0]
        if cell is None:
            missing.append(name)
        else:
            yield f"| {name} | {cell[0]} [{cell[2]}]({url_of(cell[1], data)}) |"
    if missing:
        yield f"\nNothing found, {data['searched']}: {', '.join(missing)}."
    yield ""


def page(data: dict[str, Any]) -> str:
    """The whole page."""
    others = ", ".join(f"[{name}]({url}) {version}" for name, url, version in list(data["frameworks"].values())[1:])
    lines = [HEAD, *overview(data), f"\nThe frameworks: {others}.\n"]
    group = ""
    for subject in data["subject"]:
        if subject["group"] != group:
            group = subject["group"]
            lines.append(f"## {group}\n")
        lines += section(subject, data)
    return "\n".join(lines).rstrip() + "\n"


def stale(data: dict[str, Any], today: datetime.date) -> list[str]:
    """A warning for each framework of which a statement is older than `FRESH`, with the subjects."""
    warnings = []
    for key, (name, _, _) in data["frameworks"].items():
        dates = {one["name"]: one[key][2] if key in one else data["searched"] for one in data["subject"]}
        old = {subject: date for subject, date in dates.items() if (today - date).days > FRESH}
        if old:
            warnings.append(f"{name}: read again, last on {min(old.values())} or later: {', '.join(old)}")
    return warnings


def main(words: list[str] | None = None) -> None:
    """Write the page, or warn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stale", action="store_true")
    parser.add_argument("--today", type=datetime.date.fromisoformat, default=None)
    given = parser.parse_args(words)
    data = load()
    if given.stale:
        for warning in stale(data, given.today or datetime.date.today()):
            print(warning)
    else:
        PAGE.write_text(page(data), "utf-8")


if __name__ == "__main__":
    main()
