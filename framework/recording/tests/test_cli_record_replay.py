"""`navloom run --record` and `navloom replay` in this process, on the paper's run cut short."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from navloom.cli.main import app
from navloom.config import ConfigError
from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingError
from typer.testing import CliRunner

RUN = CliRunner()
PAGE = Path(__file__).resolve().parents[3] / "docs" / "recording.md"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    done = RUN.invoke(app, ["run", "paper", "--set", "run.stop_after=3", "--record", str(path), "--json"])
    assert json.loads(done.stdout)["outcome"] == "timeout"
    return path


def test_a_recorded_run_is_replayed_bit_for_bit(recorded: Path) -> None:
    done = RUN.invoke(app, ["replay", str(recorded), "--check", "--json"])
    found = json.loads(done.stdout)
    assert done.exit_code == 0 and found["same"] and found["complete"] and found["first_difference"] is None
    by_node = {node["node"]: node for node in found["nodes"]}
    assert by_node["avoider improved_vfh@printed"]["messages"] > 60 and by_node["gate main"]["messages"] > 50
    assert found["recorder"]["dropped"] == {} and found["recorder"]["messages"] == len(list(Recording(recorded).raw()))


def test_another_avoider_is_compared_and_drawn(recorded: Path, tmp_path: Path) -> None:
    done = RUN.invoke(app, ["replay", str(recorded), "--avoider", "vff", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "avoider vff on what improved_vfh@printed was given" in done.stdout and "ticks that differ: " in done.stdout
    assert (tmp_path / "avoider.png").read_bytes().startswith(b"\x89PNG")
    (summary,) = json.loads((tmp_path / "result.json").read_text())
    rows = (tmp_path / "ticks.csv").read_text().splitlines()
    assert len(rows) == 1 + 3 * summary["ticks"] and summary["differing_share"] > 0.1


def test_another_mapper_gives_its_map(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    changes = ["--set", "run.stop_after=2", "--set", "mapper.plugin=known_map"]
    RUN.invoke(app, ["run", "explore", *changes, "--record", str(path)])
    done = RUN.invoke(app, ["replay", str(path), "--mapper", "scan_grid", "--out", str(tmp_path / "map")])
    assert done.exit_code == 0, done.output
    assert b"image: map.pgm" in (tmp_path / "map" / "map.yaml").read_bytes()


def test_an_existing_recording_is_not_written_over(recorded: Path) -> None:
    size = recorded.stat().st_size
    done = RUN.invoke(app, ["run", "paper", "--record", str(recorded)])
    assert "there is such a file already" in str(done.exception) and recorded.stat().st_size == size


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--check", "--avoider", "vff"], "three ways to replay"),
        (["--avoider", "no_such"], "no plugin 'avoider.no_such'"),
        (["--avoider", "vff", "--set", "avoider.no_such=1"], "unknown key"),
    ],
    ids=["two ways", "no plugin", "no parameter"],
)
def test_a_wrong_request_is_refused_in_one_message(recorded: Path, options: list[str], why: str) -> None:
    done = RUN.invoke(app, ["replay", str(recorded), *options])
    assert done.exit_code != 0 and why in str(done.exception)


def test_the_python_of_the_docs_runs(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(recorded.parent)
    source, _ = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)  # the other has its own test
    exec(compile(source, "recording.md", "exec"), {})


def test_a_parameter_of_a_role_that_is_not_tried_is_refused(recorded: Path) -> None:
    done = RUN.invoke(app, ["replay", str(recorded), "--avoider", "vff", "--set", "planner.cell=1"])
    assert "with a ROLE that has another plugin here: avoider" in str(done.exception)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    done = RUN.invoke(app, ["replay", str(tmp_path / "none.mcap")])
    assert isinstance(done.exception, RecordingError) and "cannot be read" in str(done.exception)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive whose scans are stamped 0.12 s late, and whose config says so."""
    path = tmp_path_factory.mktemp("late") / "run.mcap"
    delay = ("--set", "sensor.laser.stamp_delay=0.12", "--set", "sensor.laser.time_offset=-0.12")
    RUN.invoke(app, ["run", "building", "--set", "run.stop_after=4", *delay, "--record", str(path), "--json"])
    return path


def test_a_recording_keeps_the_stamps_of_the_sensor_and_its_replay_corrects_them_again(late: Path) -> None:
    stamps = [one.message.stamp_ns for one in Recording(late).messages(["platform/*/laser"])]
    assert stamps[:3] == [120_000_000, 170_000_000, 220_000_000]
    found = json.loads(RUN.invoke(app, ["replay", str(late), "--check", "--json"]).stdout)
    assert found["same"] and {node["node"] for node in found["nodes"]} >= {"gate main", "localizer global_matching"}


def test_a_replay_can_try_another_time_offset(late: Path) -> None:
    other = ["--set", "sensor.laser.time_offset=0.0"]
    found = json.loads(RUN.invoke(app, ["replay", str(late), *other, "--json"]).stdout)
    assert not found["same"] and "localizer global_matching" in found["first_difference"]


@pytest.mark.parametrize(
    "change, why",
    [
        ("sensor.lazer.time_offset=0", "there is no sensor 'lazer'; did you mean 'laser'?"),
        ("sensor.laser.beams=90", "expected sensor.laser.time_offset=SECONDS"),
        ("sensor.laser.time_offset=120", "--set sensor.0.time_offset: got 120, expected at most 0.2"),
    ],
)
def test_an_offset_that_does_not_fit_is_refused(late: Path, change: str, why: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(why)):
        RUN.invoke(app, ["replay", str(late), "--set", change], catch_exceptions=False)
