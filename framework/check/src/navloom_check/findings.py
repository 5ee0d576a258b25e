"""What checks find, and the report of all of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from navloom.errors import NavloomError

__all__ = ["CheckReport", "Finding", "NotRun", "Remark", "Result"]

Outcome = Literal["passed", "failed", "not_run", "shown"]


class NotRun(NavloomError):
    """A check that does not apply to a plugin, or cannot judge it; the text is the reason, as one phrase."""


@dataclass(frozen=True)
class Finding:
    """One fault of a plugin.

    Attributes:
        problem: What the plugin did, as one sentence without its subject: "gave a pose stamped 3.0 s".
        expected: What it should have done, and the nearest fix.
        place: File and line of the plugin, as `adapter.py:31`; empty for that of the verb.
        given: Its input, or the situation, when it did so; empty for none.
        scene: Name of the smallest scene that shows it; empty for none.
        picture: Path of a picture of it; empty for none.
    """

    problem: str
    expected: str
    place: str = ""
    given: str = ""
    scene: str = ""
    picture: str = ""


@dataclass(frozen=True)
class Remark:
    """Something that a report shows without judgement.

    Attributes:
        text: One sentence.
        values: Its numbers, by name.
        picture: Path of a picture; empty for none.
    """

    text: str
    values: dict[str, float] = field(default_factory=dict)
    picture: str = ""


@dataclass(frozen=True)
class Result:
    """Outcome of one check.

    Attributes:
        check, tier: Its name and tier.
        outcome: "shown" if it reported remarks and no fault.
        findings: The faults that it found.
        shown: Its remarks.
        reason: Why it was not run; else empty.
        seconds: How long it took.
    """

    check: str
    tier: str
    outcome: Outcome
    findings: tuple[Finding, ...] = ()
    shown: tuple[Remark, ...] = ()
    reason: str = ""
    seconds: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    @classmethod
    def of_json(cls, given: dict[str, Any]) -> Result:
        """From plain values."""
        findings = tuple(Finding(**finding) for finding in given["findings"])
        shown = tuple(Remark(**one) for one in given["shown"])
        return cls(**{**given, "findings": findings, "shown": shown})


@dataclass(frozen=True)
class CheckReport:
    """Results of all checks of one plugin.

    Attributes:
        plugin: As `avoider.vff`.
        owner: Its distribution and version, or its file.
        place: File and line of its verb or class; empty where it could not be loaded.
        seed: Of everything random in the checks.
        results: In the order they were run.
        options: Other options of the command line that repeats a check: `--set gain=2`, …
    """

    plugin: str
    owner: str
    place: str
    seed: int
    results: tuple[Result, ...]
    options: tuple[str, ...] = ()

    @property
    def failed(self) -> tuple[Result, ...]:
        """Results of the checks that found a fault."""
        return tuple(result for result in self.results if result.outcome == "failed")

    def command(self, result: Result) -> str:
        """The command line that repeats one check."""
        return " ".join(["navloom check", self.plugin, *self.options, "--only", result.check, "--seed", str(self.seed)])

    def sentences(self, result: Result) -> list[str]:
        """The findings of a check, one a line: plugin, place, problem, situation and expectation."""
        return [
            f"{self.plugin}{_in_brackets(finding.place or self.place or self.owner)}: {finding.problem}"
            + (f" [{finding.given}]" if finding.given else "")
            + f"; expected: {finding.expected}"
            for finding in result.findings
        ]

    def to_json(self) -> dict[str, Any]:
        """As plain values, for `--json`."""
        return {
            "plugin": self.plugin,
            "owner": self.owner,
            "place": self.place,
            "seed": self.seed,
            "passed": not self.failed,
            "results": [
                {
                    **result.to_json(),
                    "findings": [
                        {**asdict(finding), "plugin": self.plugin, "place": finding.place or self.place}
                        for finding in result.findings
                    ],
                    "command": self.command(result),
                }
                for result in self.results
            ],
        }


def _in_brackets(text: str) -> str:
    """To append to a name; empty for an empty text."""
    return f" ({text})" if text else ""
