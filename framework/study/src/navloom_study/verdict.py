"""The result of a study in sentences: which method is better at what, by how much, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from navloom.runs.metrics import Metric, headlines

from navloom_study.paired_differences import LEVEL, Difference
from navloom_study.report.report_tables import chance, decimals, number
from navloom_study.statistics import Comparison

__all__ = ["verdicts"]


def verdicts(found: Comparison, metrics: Sequence[Metric], untested: Mapping[str, Sequence[str]]) -> list[str]:
    """One entry for each method but the baseline, and one for the worlds that were left out.

    Args:
        found: The comparison, of the worlds that were not left out.
        metrics: Its metrics.
        untested: By role, the worlds that were left out because the role never acted in them.
    """
    by_name = {metric.name: metric for metric in metrics}
    told = []
    for method in found.methods:
        if method != found.baseline:
            every = {d.metric: d for d in found.differences if d.method == method}
            asked = next((d for d in every.values() if d.is_primary), None)
            first = (
                f"{method} and {found.baseline}: no metric that the study asks about is defined in any pair."
                if asked is None
                else _main(asked, by_name[asked.metric], found)
            )
            told.append(" ".join([first, *_exploratory(every, by_name, found.baseline)]))
    for role, worlds in untested.items():
        if set(worlds) >= set(found.worlds):
            rest = ", so no world tested it"
        else:
            rest = f" and {'are' if len(worlds) > 1 else 'is'} left out of all means"
        count = f"{len(worlds)} world" + ("s" if len(worlds) > 1 else "")
        told.append(f"The {role} never acted in {count}, which tested nothing{rest}: {_listed(worlds)}.")
    return told


def _main(one: Difference, metric: Metric, found: Comparison) -> str:
    """The primary metric: better, not told apart, equal, or impossible to tell apart."""
    method, baseline, pairs = one.method, found.baseline, f"{one.estimate.episodes} pairs"
    name = f"{metric.name}, {found.scope}" if found.scope.startswith("for") else f"{metric.name} in {found.scope}"
    assert one.attainable is not None and one.estimate.mean is not None
    if one.attainable >= 1.0 and one.estimate.mean == 0.0:
        return f"{method} and {baseline} are equal in {metric.name} in each of {pairs}."
    if not one.can_be_shown:
        return (
            f"{method} and {baseline} cannot be told apart in {metric.name}: the difference is "
            f"{_amount(one, metric)}, and no p below {chance(one.attainable)} is attainable{_needed(one)}, because "
            f"too few of {pairs} differ; drive more seeds or worlds."
        )
    sure = f"{_interval(one, metric)}p {chance(one.p_holm)}{_adjusted(found)}, {pairs}"
    if not one.is_shown:
        return f"{method} and {baseline} are not told apart in {name}: {_amount(one, metric)} ({sure})."
    better, worse = (method, baseline) if _is_better(one, metric) else (baseline, method)
    return f"{better} is better than {worse} in {name}: {method} has {_amount(one, metric)} ({sure})."


def _exploratory(every: Mapping[str, Difference], metrics: Mapping[str, Metric], baseline: str) -> list[str]:
    """What else differs in the chief metrics, unadjusted."""
    told = [
        f"{name} {_amount(one, metrics[name])} ({_interval(one, metrics[name])}p {chance(one.p)})"
        for name in headlines([*every])
        if (one := every[name]).is_shown and not one.is_primary
    ]
    return [f"Exploratory, unadjusted, against {baseline}: {'; '.join(told)}."] if told else []


def _is_better(one: Difference, metric: Metric) -> bool:
    return (one.estimate.mean or 0.0) * (1.0 if metric.better == "higher" else -1.0) > 0.0


def _adjusted(found: Comparison) -> str:
    others = len(found.methods) - 1
    return f" after Holm over {others} methods" if others > 1 else ""


def _needed(one: Difference) -> str:
    return f", where Holm needs {chance(1.0 - one.level)}" if one.level > LEVEL else ""


def _amount(one: Difference, metric: Metric) -> str:
    return _signed(one.estimate.mean or 0.0, one, metric) + _unit(metric)


def _interval(one: Difference, metric: Metric) -> str:
    low, high = one.estimate.low, one.estimate.high
    if low is None or high is None:
        return ""
    return f"{100.0 * one.level:.3g} % interval {_signed(low, one, metric)} to {_signed(high, one, metric)}, "


def _signed(value: float, one: Difference, metric: Metric) -> str:
    """A difference with its sign; of shares in percentage points."""
    scale = 100.0 if metric.is_share else 1.0
    ends = [scale * end for end in (one.estimate.mean, one.estimate.low, one.estimate.high) if end is not None]
    text = number(scale * value, 1 if metric.is_share else decimals(ends))
    return f"+{text}" if value > 0.0 else text


def _unit(metric: Metric) -> str:
    return " points" if metric.is_share else "" if metric.unit in ("1", "?") else f" {metric.unit}"


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
