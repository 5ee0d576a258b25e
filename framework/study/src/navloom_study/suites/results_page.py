"""The page of results: every method of every suite, what others publish, and what became of the paper's claims."""

from __future__ import annotations

import html
import shlex
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from navloom.config import ConfigError
from navloom.plugins import Discovery, PluginError

from navloom_study.suites.result_file import SuiteResult
from navloom_study.suites.results_store import known_results, stem_of, stored_cost
from navloom_study.suites.suite import SuiteTable, read_suite_table, suite_names
from navloom_study.suites.suite_run import family_names

__all__ = ["command_of", "results_page", "verdict"]

ARRIVES, FAILS = 0.95, 0.05
"""Share of drives from which on a method arrives always, and up to which it never does, for a claim."""

HEAD = """# Results

<!-- made by `navloom results page`: do not edit -->
Every method in every suite. A *suite* is a fixed set of worlds, robot conditions and seeds with one primary metric.
A cell has the mean over worlds with its 95 % interval ([metrics](metrics.md)); *not run* means that no result is stored
yet. A click on a cell shows the command that makes it. [Comparing methods](comparing.md#suites) says how to add a row,
and how rows are checked.

These are scores of a simulator in two dimensions: they rank methods here. Scores of other robots and simulators stand
[beside ours](#published-figures) with their conditions.
"""


def results_page(folder: Path, base: Path) -> str:
    """The page, Markdown whose wide tables are HTML.

    Args:
        folder: The stored results; those that come with navloom are beside them.
        base: Folder of the page, which paths of pictures are relative to.
    """
    suites = _suites()
    found = {(result.suite, method): result for result in known_results(folder) for method in result.methods}
    parts = [HEAD, "## All suites\n", _matrix(folder, suites, found)]
    for name, table in suites.items():
        parts += [f"## {name}\n", f"{table.about} Primary metric: `{table.primary}`.\n"]
        of_suite = {method: result for (suite, method), result in found.items() if suite == name}
        parts += _of_suite(folder, base, table, of_suite)
    parts += ["## Published figures\n", _published(suites), "## The paper's claims\n", _claims(found)]
    return "\n".join(parts)


def command_of(folder: Path, suite: str, method: str, result: SuiteResult | None = None) -> str:
    """The command that makes a cell. A method that is not the suite's own is in the file stored with its result."""
    words = ["navloom", "compare", "--suite", suite]
    if result is None or result.methods[method].get("set") is None:
        return shlex.join([*words, "--methods", method])
    plugins = [word for name in result.plugin_files for word in ("--plugin", name)]
    return shlex.join([*words, "--method", (folder / suite / f"{stem_of(method)}.toml").as_posix(), *plugins])


def _suites() -> dict[str, SuiteTable]:
    discovery, found = Discovery(), {}
    for name in suite_names(discovery):
        try:
            found[name] = read_suite_table(discovery.suite(name))[0]
        except (ConfigError, PluginError):  # of a stranger's distribution: the others have a page all the same
            continue
    return found


def _matrix(folder: Path, suites: Mapping[str, SuiteTable], found: Mapping[tuple[str, str], SuiteResult]) -> str:
    own = {name: family_names(table.methods) for name, table in suites.items()}
    methods = dict.fromkeys([*(m for names in own.values() for m in names), *(m for _, m in found)])
    lines = ['<div class="results" markdown="0">', '<table id="every-result" class="rows"><thead><tr><th>method</th>']
    lines += [
        f'<th><a href="#{name}">{name}</a><br><small>{table.primary}</small></th>' for name, table in suites.items()
    ]
    lines.append("</tr></thead><tbody>")
    for method in methods:
        lines.append(f"<tr><th>{html.escape(method)}</th>")
        for name in suites:
            result = found.get((name, method))
            if result is None and method not in own[name]:
                lines.append('<td class="none">–</td>')
                continue
            command = html.escape(command_of(folder, name, method, result), quote=True)
            text = "not run" if result is None else _interval(result.summary[method]["metrics"][result.primary])
            kind = ' class="none"' if result is None else ""
            lines.append(f'<td{kind} data-command="{command}" title="{command}">{text}</td>')
        lines.append("</tr>")
    return "\n".join([*lines, "</tbody></table></div>\n"])


def _interval(ends: Sequence[float | None]) -> str:
    mean, low, high = ends
    if mean is None:
        return "–"
    return f"{mean:.3f}" if low is None else f"{mean:.3f} <small>[{low:.3f},&nbsp;{high:.3f}]</small>"


def _of_suite(folder: Path, base: Path, table: SuiteTable, found: Mapping[str, SuiteResult]) -> Iterable[str]:
    """Tables, sentences and pictures of one suite."""
    names = [*found]
    missing = [method for method in family_names(table.methods) if method not in found]
    if not names:
        yield "No method has been run yet.\n"
        return
    parts = [*next(iter(found.values())).summary[names[0]]["parts"]]
    lines = ['<div class="results" markdown="0">', '<table class="rows"><thead><tr><th>method</th>']
    heads = [
        table.primary,
        *(f"{part}: reached" for part in parts),
        "contacts",
        "step, ms",
        "checked",
        "command",
    ]
    lines += [f"<th>{html.escape(head)}</th>" for head in heads]
    lines.append("</tr></thead><tbody>")
    for method, result in found.items():
        told, cost = result.summary[method], stored_cost(folder, table.name, method)
        cells = [_interval(told["metrics"][result.primary])]
        cells += [f"{told['parts'][part]['reached']} of {told['parts'][part]['episodes']}" for part in parts]
        cells.append(str(sum(told["parts"][part]["contacts"] for part in parts)))
        cells.append(f"{cost['step_us'] / 1e3:.2f}" if cost else "–")
        cells.append(f"{result.checked.get('sample', 0)} of {told['episodes']}")
        command = html.escape(command_of(folder, table.name, method, result), quote=True)
        cells.append(f"<code>{command}</code>")
        row = "".join(f"<td>{cell}</td>" for cell in cells)
        lines.append(f'<tr data-command="{command}"><th>{html.escape(method)}</th>{row}</tr>')
    yield "\n".join([*lines, "</tbody></table></div>\n"])
    if missing:
        yield f"Not run: {', '.join(f'`{name}`' for name in missing)}.\n"
    yield from _sentences(table, found, parts)
    yield _computed(folder, table, found)
    yield from _pictures(folder, base, table, found)


def _sentences(table: SuiteTable, found: Mapping[str, SuiteResult], parts: Sequence[str]) -> Iterable[str]:
    """Sentences that can be quoted."""
    if table.primary != "success":
        best = sorted(found, key=lambda m: -(found[m].summary[m]["metrics"][table.primary][0] or 0.0))
        told = ", ".join(f"`{m}` {_interval(found[m].summary[m]['metrics'][table.primary])}" for m in best)
        yield f"> On {table.name}, the mean `{table.primary}` is: {told}.\n"
        return
    for part in parts:
        counts = {method: result.summary[method]["parts"][part] for method, result in found.items()}
        total = max(count["episodes"] for count in counts.values())
        order = sorted(counts, key=lambda method: counts[method]["reached"])
        told = ", ".join(f"`{method}` {counts[method]['reached']}" for method in order)
        yield f"> On {table.name}, {part}, of {total} drives there arrive: {told}.\n"


def _computed(folder: Path, table: SuiteTable, found: Mapping[str, SuiteResult]) -> str:
    """Where the cost of computing was measured, and at what load."""
    costs = [cost for method in found if (cost := stored_cost(folder, table.name, method))]
    if not costs:
        return ""
    processors = ", ".join(sorted({cost["processor"] for cost in costs}))
    load = max(cost["load"] for cost in costs)
    return (
        f"*Step*: CPU time that 99 of 100 control steps of the whole robot stay below, median over drives, on "
        f"{processors}, at a load of up to {load:g}.\n"
    )


def _pictures(folder: Path, base: Path, table: SuiteTable, found: Mapping[str, SuiteResult]) -> Iterable[str]:
    lines = []
    for method in found:
        cells = []
        for kind in ("typical", "worst"):
            file = folder / table.name / f"{stem_of(method)}-{kind}.png"
            there = file.relative_to(base) if file.is_relative_to(base) else file
            cells.append(f"![{kind} drive of {method} in {table.name}]({there.as_posix()})" if file.is_file() else "–")
        lines.append(f"| `{method}` | {' | '.join(cells)} |")
    yield "| method | typical drive | worst drive |\n|---|---|---|\n" + "\n".join(lines) + "\n"


def _published(suites: Mapping[str, SuiteTable]) -> str:
    """What others publish of the same kind of worlds."""
    lines = ["| suite | method | score | reached | conditions |", "|---|---|---:|---:|---|"]
    for figure in _table("published.toml")["figure"]:
        if figure["suite"] in suites:
            lines.append(
                "| " + " | ".join(figure[key] for key in ("suite", "method", "figure", "reached", "conditions")) + " |"
            )
    return "\n".join(lines) + (
        "\n\nThe scores are those of `barn_2_8`. Body, speed, motors and physics decide them: none of these rows was "
        "driven here. For the other suites we know of no published figures under comparable conditions.\n"
    )


def _claims(found: Mapping[tuple[str, str], SuiteResult]) -> str:
    lines = ["| the paper says | suite | found | verdict |", "|---|---|---|---|"]
    for claim in _table("claims.toml")["claim"]:
        word, told = verdict(claim, found)
        lines.append(f"| {claim['says']} | `{claim['suite']}` | {told} | **{word}** |")
    return "\n".join(lines) + (
        "\n\n*Confirmed*: in every condition of the suite. *Refined*: in some of them. *Refuted*: in none, or the "
        "opposite. Statements on mapping, planning and control are tested by [the paper reproduced](paper.md).\n"
    )


def verdict(claim: Mapping[str, str], found: Mapping[tuple[str, str], SuiteResult]) -> tuple[str, str]:
    """Whether a claim is confirmed, refined or refuted, and the counts that say so; `not run` without results."""
    names = [name for name in (claim["method"], claim.get("than")) if name]
    results = {name: found.get((claim["suite"], name)) for name in names}
    if missing := [name for name, result in results.items() if result is None]:
        return "not run", f"no result of {', '.join(f'`{name}`' for name in missing)}"
    counts = {name: result.summary[name]["parts"] for name, result in results.items() if result is not None}
    own = counts[claim["method"]]
    shares = {part: count["reached"] / count["episodes"] for part, count in own.items()}
    if claim["expects"] == "better":
        other = counts[claim["than"]]
        more = {part for part, count in own.items() if count["reached"] > other[part]["reached"]}
        # Where both always arrive, there is nothing to be better at.
        holds = all(part in more or (share >= ARRIVES and other[part] == own[part]) for part, share in shares.items())
        holds, fails = holds and bool(more), not more
    else:
        is_arrival = claim["expects"] == "arrives"
        agree = [share >= ARRIVES if is_arrival else share <= FAILS for share in shares.values()]
        holds, fails = all(agree), not any(agree)
    told = "; ".join(f"{part}: {', '.join(_reached(name, counts[name][part]) for name in names)}" for part in own)
    return "confirmed" if holds else "refuted" if fails else "refined", told


def _reached(name: str, count: Mapping[str, int]) -> str:
    return f"`{name}` {count['reached']} of {count['episodes']}"


def _table(name: str) -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_name(name).read_text("utf-8"))
