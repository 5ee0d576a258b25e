"""Files that commands write: none is overwritten, and a full disk costs neither the answer nor complete files."""

from __future__ import annotations

import fcntl
import json
import resource
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from navloom.engine.trace import read_trace
from navloom_recording.reader import Recording
from navloom_study import compare, study_folder
from navloom_study.report import study_report

CONFIG = """
[run]
stop_after = 20.0

[world]
ref = "empty"

[robot]
footprint = { length = 0.8, width = 0.8 }

[mapper]
plugin = "known_map"

[controller]
plugin = "kanayama"

[navigation]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 1.0 }

[[sensor]]
name = "sonars"
kind = "sonar_ring"
layout = "p3dx"
"""
Run = Callable[..., tuple[int, str, str]]
TOO_LARGE = "File too large"


@pytest.fixture
def config(tmp_path: Path) -> str:
    path = tmp_path / "robot.toml"
    path.write_text(CONFIG, "utf-8")
    return str(path)


@contextmanager
def no_file_over(size: int) -> Iterator[None]:
    """Limits the size of files of this process and its children, which fails writes as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def study(in_process: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `compare` with its episodes in this process and without figures, which are tested elsewhere."""
    real = compare.run_study

    def in_thread(study: compare.Study, out: Path | None, **options: Any) -> compare.StudyResult:
        with ThreadPoolExecutor(1) as executor:
            return real(study, out, executor=executor, progress=options["progress"])

    monkeypatch.setattr(compare, "run_study", in_thread)
    monkeypatch.setattr(study_report, "svg_of", lambda figure: "<svg></svg>")
    return lambda *words: in_process("compare", *words)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_run_says_what_it_wrote(in_process: Run, config: str, tmp_path: Path) -> None:
    out, record = tmp_path / "out", tmp_path / "run.mcap"
    code, said, _ = in_process("run", config, "--out", str(out), "--record", str(record))
    count = len(list(Recording(record).messages()))
    assert code == 0 and count > 100
    assert f"recorded in {record}: {count} messages, {record.stat().st_size / 1e6:.2f} MB\n" in said
    assert f"written to {out}: trace.bin, result.json, map.pgm, map.yaml, run.png\n" in said
    assert names(out) == ["map.pgm", "map.yaml", "result.json", "run.png", "trace.bin"]


def test_json_says_what_a_run_wrote(in_process: Run, config: str, tmp_path: Path) -> None:
    record = tmp_path / "run.mcap"
    _, said, _ = in_process("run", config, "--out", str(tmp_path / "out"), "--record", str(record), "--json")
    written = json.loads(said)["written"]
    assert written["out"]["folder"] == str(tmp_path / "out") and written["out"]["missing"] == {}
    assert sorted(written["out"]["files"]) == names(tmp_path / "out")
    size, count = record.stat().st_size, len(list(Recording(record).messages()))
    assert written["record"] == {"file": str(record), "messages": count, "bytes": size, "complete": True}


def test_an_earlier_result_is_never_written_over(in_process: Run, config: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    assert in_process("run", config, "--out", str(out))[0] == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    code, said, errors = in_process("run", config, "--seed", "3", "--out", str(out))
    assert (code, said) == (2, "")
    assert errors == f"navloom: --out {out}: holds trace.bin of an earlier result; name another folder, or remove it\n"
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_the_folder_of_a_killed_run_is_reused_and_that_of_a_running_one_is_not(
    in_process: Run, config: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / ".trace.bin.part").write_bytes(b"torn")
    with (out / ".trace.bin.part").open("ab") as theirs:
        fcntl.flock(theirs, fcntl.LOCK_EX)
        code, _, errors = in_process("run", config, "--out", str(out))
        assert code == 2 and "another run writes there now; name another folder" in errors
    assert in_process("run", config, "--out", str(out))[0] == 0
    assert "trace.bin" in names(out) and ".trace.bin.part" not in names(out)
    assert len(list(read_trace(out / "trace.bin"))) > 100


def test_a_refused_run_leaves_neither_folder_nor_recording(in_process: Run, config: str, tmp_path: Path) -> None:
    words = ("--out", str(tmp_path / "out"), "--record", str(tmp_path / "run.mcap"))
    code, _, errors = in_process("run", config, "--set", "navigation.goal.x=1e4", *words)
    assert code == 2 and errors
    assert names(tmp_path) == ["robot.toml"]


def test_a_full_disk_costs_neither_the_answer_nor_files_that_fit(in_process: Run, config: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with no_file_over(20_000):
        code, said, errors = in_process("run", config, "--out", str(out), "--json")
    found = json.loads(said)
    missing = {"trace.bin": TOO_LARGE, "run.png": TOO_LARGE, "map.pgm": TOO_LARGE, "map.yaml": "without map.pgm"}
    assert code == 1 and found["truly_reached"] and found["written"]["out"]["missing"] == missing
    assert (
        f"navloom: --out {out}: not written: trace.bin ({TOO_LARGE}), map.pgm ({TOO_LARGE}), "
        f"map.yaml (without map.pgm), run.png ({TOO_LARGE}); complete there: result.json\n"
    ) in errors
    assert names(out) == ["result.json"]
    kept = json.loads((out / "result.json").read_text("utf-8"))
    assert kept["trace_sha256"] == found["trace_sha256"]


def test_a_recording_on_a_full_disk_is_exit_1_and_can_be_read(in_process: Run, config: str, tmp_path: Path) -> None:
    record = tmp_path / "run.mcap"
    with no_file_over(30_000):
        code, said, errors = in_process("run", config, "--record", str(record))
    assert code == 1 and said.startswith("succeeded: ")
    size = record.stat().st_size
    told = f"navloom: {record}: {TOO_LARGE}; the recording ends here, with {size} bytes that can be read\n"
    assert errors.count(told) == 1
    count = len(list(Recording(record).messages()))
    assert f"recorded in {record}: {count} messages" in said


def test_a_recording_that_cannot_begin_is_exit_1_and_leaves_no_file(
    in_process: Run, config: str, tmp_path: Path
) -> None:
    with no_file_over(100):
        code, said, errors = in_process("run", config, "--record", str(tmp_path / "run.mcap"))
    assert (code, said) == (1, "") and f"run.mcap: {TOO_LARGE}; nothing was recorded" in errors
    assert names(tmp_path) == ["robot.toml"]


@pytest.mark.skipif(find_spec("rerun") is None, reason="the extra `view` is not installed")
def test_the_viewers_file_is_not_overwritten_and_a_full_disk_is_exit_1(
    in_process: Run, config: str, tmp_path: Path
) -> None:
    rerun = tmp_path / "run.rrd"
    with no_file_over(20_000):
        code, said, errors = in_process("run", config, "--rerun", str(rerun), "--json")
    found = json.loads(said)
    assert code == 1 and found["truly_reached"] and found["written"]["rerun"]["complete"] is False
    size = rerun.stat().st_size
    assert f"--rerun {rerun}: " in errors and f"it is cut short, and its first {size} bytes can be viewed" in errors
    code, _, errors = in_process("run", config, "--rerun", str(rerun))
    assert code == 2 and "there is such a file already; name another, or remove it" in errors
    assert rerun.stat().st_size == size


def test_a_study_on_a_full_disk_keeps_its_episodes_and_continues_later(study: Run, config: str, tmp_path: Path) -> None:
    out = tmp_path / "study"
    words = (config, "--seeds", "0:3", "--out", str(out), "--json")
    kept = out / "journal.jsonl"

    def fill(path: Path, content: bytes) -> None:
        real(path, content)
        if kept.stat().st_size and not limit:
            limit.append(no_file_over(kept.stat().st_size + 10))
            limit[0].__enter__()

    real, limit = study_folder.write_whole, []  # type: ignore[var-annotated]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_folder, "write_whole", fill)
        try:
            code, said, errors = study(*words)
        finally:
            limit[0].__exit__(None, None, None)
    assert (code, said) == (1, "")
    told = f"journal.jsonl: {TOO_LARGE}; 1 episodes are kept: make room, and the same command goes on from there\n"
    assert f"navloom: --out {out}: " in errors and told in errors
    assert kept.read_bytes().endswith(b"\n") and len(kept.read_bytes().splitlines()) == 1
    code, said, _ = study(*words)
    found = json.loads(said)
    assert code == 0 and found["went_on_from"] == 1 and len(found["episodes"]) == 3


def test_tables_that_do_not_fit_are_named_and_the_study_is_still_printed(
    study: Run, in_process: Run, config: str, tmp_path: Path
) -> None:
    out = tmp_path / "study"
    words = (config, "--out", str(out))
    real = study_folder.write_each

    def full(folder: Path, files: Mapping[str, str | bytes]) -> dict[str, str]:
        with no_file_over(50):
            return real(folder, files)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_folder, "write_each", full)
        code, said, errors = study(*words)
    assert code == 1 and "1 methods x 1 worlds x 1 seeds: 1 episodes" in said
    assert f"not written: episodes.csv ({TOO_LARGE}), timing.json ({TOO_LARGE}); complete there: study.json" in errors
    assert not [name for name in names(out) if name.endswith(".part")]
    code, said, _ = study(*words)
    assert code == 0 and "1 of them from an earlier run" in said and "report.html" in names(out)
    with no_file_over(2_000):
        code, said, errors = in_process("report", str(out), "--json")
    assert code == 1 and "report.html" not in json.loads(said)["files"]
    assert f"report.html ({TOO_LARGE})" in errors and (out / "report.html").stat().st_size > 2_000


def test_a_replay_follows_the_same_rules(in_process: Run, config: str, tmp_path: Path) -> None:
    record, out = tmp_path / "run.mcap", tmp_path / "out"
    in_process("run", config, "--record", str(record), "--json")
    words = ("replay", str(record), "--controller", "lyapunov_tracker", "--out")
    with no_file_over(1_500):
        code, said, errors = in_process(*words, str(out), "--json")
    assert code == 1 and json.loads(said)[0]["role"] == "controller"
    assert f"ticks.csv ({TOO_LARGE}), controller.png ({TOO_LARGE}); complete there: result.json" in errors
    assert names(out) == ["result.json"]
    code, _, errors = in_process(*words, str(out))
    assert code == 2 and "holds result.json of an earlier result" in errors
    code, _, errors = in_process("replay", str(record), "--out", str(out))
    assert code == 2 and "holds result.json of an earlier result" in errors


def test_a_replay_without_navloom_study_keeps_the_rest(
    in_process: Run, config: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record, out = tmp_path / "run.mcap", tmp_path / "out"
    in_process("run", config, "--record", str(record), "--json")
    monkeypatch.setitem(sys.modules, "navloom_study", None)
    code, said, errors = in_process("replay", str(record), "--controller", "lyapunov_tracker", "--out", str(out))
    assert code == 0 and f"written to {out}: result.json, ticks.csv\n" in said
    assert "no picture is drawn, the rest is kept: a picture needs navloom-study, which is not installed" in errors
    assert names(out) == ["result.json", "ticks.csv"]


def test_a_map_follows_the_same_rules(in_process: Run, tmp_path: Path) -> None:
    sweep, out = tmp_path / "sweep.npz", tmp_path / "out"
    pitch = np.linspace(-30.0, 10.0, 60)
    beams = np.linspace(-40.0, 40.0, 81)
    down = -np.sin(np.deg2rad(pitch))[:, None] * np.cos(np.deg2rad(beams))
    ranges = np.minimum(np.where(down > 0.05, 1.0 / np.maximum(down, 0.05), 4.0), 4.0)
    np.savez(sweep, ranges_m=ranges, pitch_deg=pitch, beam_deg=beams)
    words = ("map", str(sweep), "--pitch-offset", "0", "--height", "1.0", "--out", str(out), "--json")
    with no_file_over(600):
        code, said, errors = in_process(*words)
    assert code == 1 and "points" in json.loads(said)
    assert f"map.png ({TOO_LARGE})" in errors and "complete there: result.json" in errors
    code, _, errors = in_process(*words)
    assert code == 2 and "holds result.json of an earlier result; name another folder, or remove it" in errors
