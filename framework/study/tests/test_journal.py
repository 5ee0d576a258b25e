"""The journal of a study: an episode with a damaged line runs again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from navloom_study.episode_key import EpisodeKey
from navloom_study.journal import StudyFolder, open_loop_table, table_of
from navloom_study.openloop import METHOD
from navloom_study.rows import Row

REQUEST: dict[str, Any] = {"metrics": ["spl"], "open_loop": {"shadows": {"vff": "b"}}}
SHADOW = {
    "role": "avoider", "instance": "vff", "against": ["a"], "ticks": 9, "unanswered": 0, "differing_share": None,
    "first_differing_tick": None, "first_differing_s": None, "differences": {}, "driving": None,
}  # fmt: skip


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
    kept = [row(), row(METHOD, shadows=(SHADOW,)), row(seed=1, notes=("a metric broke",))]
    assert resumed(tmp_path, *(one.to_json() for one in kept)) == kept


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
        ("shadows", [{**SHADOW, "differing_share": "0.1"}]),
    ],
)
def test_an_episode_with_a_wrong_value_runs_again(tmp_path: Path, key: str, value: object) -> None:
    assert resumed(tmp_path, row().to_json(), {**row(seed=1).to_json(), key: value}) == [row()]
    assert len((tmp_path / "journal.jsonl").read_text("utf-8").splitlines()) == 1


def test_an_episode_with_an_unknown_shadow_runs_again(tmp_path: Path) -> None:
    other = row(METHOD, shadows=({**SHADOW, "instance": "dwa"},))
    assert resumed(tmp_path, other.to_json()) == []
