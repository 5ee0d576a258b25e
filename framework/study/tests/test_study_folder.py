"""The journal of a study: an episode with a damaged line runs again."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from navloom.engine.run_warnings import RunWarning
from navloom.runs.shadow_comparison import DrivingSummary, ShadowSummary, Sizes
from navloom_study.episode_key import EpisodeKey
from navloom_study.episode_rows import Row
from navloom_study.openloop import METHOD
from navloom_study.study_folder import Compared, StudyFolder, open_loop_lines, open_loop_table, rows_of, table_of

REQUEST: dict[str, Any] = {"metrics": ["spl"], "open_loop": {"shadows": {"vff": "b"}}}
SHADOW = ShadowSummary("avoider", "vff", ["a"], ticks=9, unanswered=0, differing_share=None)
WARNING = RunWarning("slow", "avoider", "vff", "vfh", "is slow: 9 ms", {"ms": 9.0}, "step")


def row(method: str = "a", seed: int = 0, **more: Any) -> Row:
    metrics = {} if method == METHOD else {"spl": 0.5}
    return Row(EpisodeKey(method, "empty", seed), "succeeded", "", metrics, "ab", {"wall_s": 1.0}, **more)


def resumed(folder: Path, *lines: Any) -> list[Row]:
    """Episodes that a study reuses from its journal, once its tables are written."""
    with StudyFolder(folder, REQUEST):
        pass
    (folder / "journal.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines), "utf-8")
    with StudyFolder(folder, REQUEST) as study:
        rows = list(study.rows.values())
    table_of([one for one in rows if one.key.method != METHOD], REQUEST["metrics"])
    open_loop_table([one for one in rows if one.key.method == METHOD], REQUEST["open_loop"]["shadows"])
    return rows


def test_whole_lines_are_taken_over(tmp_path: Path) -> None:
    kept = [row(), row(METHOD, shadows=(SHADOW,)), row(seed=1, notes=("a metric broke",), warnings=(WARNING,))]
    rows = resumed(tmp_path, *(one.to_json() for one in kept))
    assert rows == kept and rows[2].warnings == (WARNING,)  # two rows that differ in their warnings are equal
    before = row(METHOD, shadows=(SHADOW,)).to_json()
    del before["shadows"][0]["stops"], before["shadows"][0]["handovers"]  # as earlier versions wrote them
    assert resumed(tmp_path / "before", before) == [kept[1]]


def test_the_tables_of_a_study_come_back_as_they_were() -> None:
    rows = [row(), replace(row(seed=1), outcome="stuck", reason='it, "so to speak", waits', metrics={"spl": None})]
    assert rows_of(table_of(rows, ["spl"]), ["spl"]) == [replace(one, timing={}) for one in rows]
    driving = DrivingSummary(4, 0.25, {"vx": Sizes(0.125, 0.5)})
    differences = {"vx": Sizes(0.25, 1.0), "wz": Sizes(0.0, 0.0)}
    shadow = replace(SHADOW, differing_share=0.5, differences=differences, driving=driving)
    first, second, empty = open_loop_lines(
        open_loop_table([row(METHOD, shadows=(shadow,)), row(METHOD, 1, shadows=(SHADOW,))], {"vff": "b"})
    )
    assert (first.method, first.role, first.world, first.seed, first.quantity) == ("b", "avoider", "empty", 0, "vx")
    assert first.all_ticks == Compared(9, 0.5, 0.25, 1.0) and first.while_driving == Compared(4, 0.25, 0.125, 0.5)
    assert second.quantity == "wz" and second.all_ticks == Compared(9, 0.5, 0.0, 0.0)
    assert second.while_driving == Compared(4, 0.25, None, None)  # of this quantity nothing was compared while it drove
    assert (empty.seed, empty.quantity) == (1, "") and empty.while_driving == Compared(None, None, None, None)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("method", ["a"]),
        ("seed", "1"),
        ("outcome", None),
        ("metrics", {}),
        ("metrics", {"spl": "0.5"}),
        ("metrics", {"spl": 10**400}),
        ("timing", {"wall_s": []}),
        ("notes", 3),
        ("shadows", [{**SHADOW.to_json(), "differing_share": "0.1"}]),
    ],
)
def test_an_episode_with_a_wrong_value_runs_again(tmp_path: Path, key: str, value: object) -> None:
    assert resumed(tmp_path, row().to_json(), {**row(seed=1).to_json(), key: value}) == [row()]
    assert len((tmp_path / "journal.jsonl").read_text("utf-8").splitlines()) == 1


def test_an_episode_with_an_unknown_shadow_runs_again(tmp_path: Path) -> None:
    other = row(METHOD, shadows=(replace(SHADOW, instance="dwa"),))
    assert resumed(tmp_path, other.to_json()) == []
