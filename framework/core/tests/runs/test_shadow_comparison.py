"""Shadows compared tick by tick: the pairing, the summary, and that the run does not change."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest
from navloom.messages import Command, Envelope, HandOver, Message, Twist2D
from navloom.runs.episode import Episode, run_episode
from navloom.runs.result_folder import ResultFolder
from navloom.runs.shadow_comparison import DrivingSummary, ShadowWatch, Sizes, shadow_table
from toys import discovery, toy_config

AVOIDER = """
[[alternative]]
name = "slow"
role = "avoider"
plugin = "toy_bystander"
share = 0.1
"""
OTHERS = """
[[alternative]]
name = "eager"
role = "controller"
plugin = "toy_chaser"
gain = 2.0

[[alternative]]
name = "short"
role = "planner"
plugin = "toy_straight"
reach = 1.0

[[alternative]]
name = "small"
role = "mapper"
plugin = "toy_blank"
size = 20
"""


def drive(tmp_path: Path, *overrides: str, more: str = AVOIDER) -> Episode:
    return run_episode(toy_config(tmp_path, *overrides, more=more), discovery=discovery())


def say(watch: ShadowWatch, instance: str, active: bool, tick: int, vx: float) -> None:
    told = Command(Twist2D(vx, 0.0, 0.0))
    publish(watch, instance, active, "command", tick, told)


def publish(watch: ShadowWatch, instance: str, active: bool, port: str, tick: int, told: Message) -> None:
    stamp = tick * 50_000_000
    watch.on_message("avoider", instance, active, port, told, Envelope("k", 0, tick, stamp, stamp, 0))


def test_differences_are_summed_up_by_tick() -> None:
    watch = ShadowWatch({"avoider": ("other",)})
    for tick, (ours, theirs) in enumerate([(0.3, 0.3), (0.3, 0.305), (0.3, 0.0), (0.3, 0.7)]):
        say(watch, "main", True, tick, ours)
        say(watch, "other", False, tick, theirs)
    (found,) = watch.finish()
    summary = found.summary()
    # 0, 0.005, -0.3 and 0.4 m/s; 5 mm/s is within the tolerance.
    assert summary.differences["vx"].rms == pytest.approx(math.sqrt((0.005**2 + 0.09 + 0.16) / 4))
    assert summary.differences["vx"].max == pytest.approx(0.4)
    assert (summary.ticks, summary.unanswered, summary.differing_share) == (4, 0, 0.5)
    assert (summary.first_differing_tick, summary.first_differing_s) == (2, pytest.approx(0.1))
    assert summary.against == ["main"]


def test_answers_of_one_tick_are_paired_however_late_one_is_published() -> None:
    watch = ShadowWatch({"avoider": ("late",)}, horizon=2)
    say(watch, "main", True, 0, 0.1)
    say(watch, "main", True, 1, 0.2)
    say(watch, "main", True, 2, 0.3)
    say(watch, "late", False, 0, 0.5)
    say(watch, "main", True, 3, 0.4)
    say(watch, "late", False, 1, 0.6)
    (found,) = watch.finish()
    assert found.ticks == [0, 1] and found.values["vx"] == pytest.approx([0.4, 0.4])
    assert found.unanswered == 2


def test_silence_of_either_is_counted() -> None:
    watch = ShadowWatch({"avoider": ("other",)})
    say(watch, "main", True, 0, 0.1)
    say(watch, "other", False, 1, 0.1)
    (found,) = watch.finish()
    assert (found.unanswered, found.ticks) == (2, [])
    summary = found.summary()
    assert summary.differing_share is None and summary.differences == {}


def test_after_a_swap_the_old_instance_is_the_shadow() -> None:
    watch = ShadowWatch({"avoider": ("other",)})
    say(watch, "main", True, 0, 0.1)
    say(watch, "other", False, 0, 0.2)
    say(watch, "other", True, 1, 0.2)
    say(watch, "main", False, 1, 0.1)
    first, second = watch.finish()
    assert (first.instance, first.against, first.values["vx"]) == ("other", ["main"], [pytest.approx(0.1)])
    assert (second.instance, second.against, second.values["vx"]) == ("main", ["other"], [pytest.approx(-0.1)])


def test_ticks_in_which_the_avoider_drove_are_summarised_separately() -> None:
    watch = ShadowWatch({"avoider": ("other",)})
    for tick, engaged in enumerate([False, True]):
        say(watch, "main", True, tick, 0.0)
        publish(watch, "main", True, "handover", tick, HandOver(engaged, 1.0))
        say(watch, "other", False, tick, 0.4 if engaged else 0.2)
        publish(watch, "other", False, "handover", tick, HandOver(True, 1.0))
    (found,) = watch.finish()
    flat = Sizes(0.0, 0.0)
    driving = found.summary().driving
    assert driving == DrivingSummary(1, 1.0, {"vx": Sizes(0.4, 0.4), "vy": flat, "wz": flat})


def test_a_shadow_avoider_is_compared_in_a_run_and_changes_nothing(tmp_path: Path) -> None:
    episode = drive(tmp_path)
    (found,) = episode.summary()["shadows"]
    # It commands a tenth of the desired speed, the active one half: 0.4 times at most 0.4 m/s less.
    assert (found["role"], found["instance"], found["against"]) == ("avoider", "slow", ["toy_bystander"])
    assert 0.08 - 1e-9 <= found["differences"]["vx"]["rms"] <= 0.16 + 1e-9
    assert found["differences"]["vx"]["max"] == pytest.approx(0.16) and found["differences"]["wz"]["max"] == 0.0
    assert found["ticks"] > 100 and found["unanswered"] == 0 and found["differing_share"] == 1.0
    assert drive(tmp_path, more="").log.trace_sha256 == episode.log.trace_sha256


def test_controllers_planners_and_mappers_are_compared_too(tmp_path: Path) -> None:
    found = {shadow["instance"]: shadow for shadow in drive(tmp_path, more=OTHERS).summary()["shadows"]}
    # The goal is 3 m away and the shadow plans 1 m far; its map has 20 x 20 of our 40 x 40 cells, the rest is unknown.
    assert found["short"]["differences"] == {"found": {"rms": 1.0, "max": 1.0}}
    assert found["small"]["differences"]["cells"]["max"] == pytest.approx(0.75)
    assert found["eager"]["ticks"] > 100 and found["eager"]["driving"] is None


def test_with_latency_answers_to_the_same_inputs_are_compared(tmp_path: Path) -> None:
    (found,) = drive(tmp_path, more=AVOIDER + "latency = 0.6\n").summary()["shadows"]
    assert found["differences"]["vx"]["max"] == pytest.approx(0.16) and found["differences"]["wz"]["max"] == 0.0
    # The answers of the last 0.6 s were not published; for 0.45 s of them the robot brakes without a reference.
    assert 0 < found["unanswered"] <= 4


def test_without_shadows_there_is_no_summary(tmp_path: Path) -> None:
    episode = drive(tmp_path, more=AVOIDER + "shadow = false\n")
    assert episode.shadows == [] and episode.summary()["shadows"] == []


def test_a_folder_keeps_every_difference(tmp_path: Path) -> None:
    loaded = toy_config(tmp_path, more=AVOIDER)
    with ResultFolder(tmp_path / "out") as folder:
        episode = run_episode(loaded, discovery=discovery(), trace=folder.trace)
        folder.keep(episode, episode.summary())
    assert "shadows.csv" in folder.names
    with (tmp_path / "out" / "shadows.csv").open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    (found,) = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["shadows"]
    assert len(lines) == 3 * found["ticks"]
    assert max(abs(float(line["difference"])) for line in lines) == pytest.approx(found["differences"]["vx"]["max"])
    assert {line["instance"] for line in lines} == {"slow"} and {line["differs"] for line in lines} == {"1"}
    assert drive(tmp_path).shadows[0].ticks == episode.shadows[0].ticks
    assert shadow_table(drive(tmp_path).shadows) == (tmp_path / "out" / "shadows.csv").read_text("utf-8")


def test_ticks_in_which_a_shadow_would_stop_or_hand_over_otherwise_are_counted() -> None:
    watch = ShadowWatch({"avoider": ("other",)})
    for tick, (ours, theirs, hands_over) in enumerate([(0.3, 0.0, True), (0.0, 0.0, False), (0.3, 0.2, False)]):
        say(watch, "main", True, tick, ours)
        publish(watch, "main", True, "handover", tick, HandOver(True, 1.0))
        say(watch, "other", False, tick, theirs)
        publish(watch, "other", False, "handover", tick, HandOver(hands_over, 1.0))
    (found,) = watch.finish()
    assert (found.stops, found.handovers) == (1, 2)
    assert (found.summary().stops, found.summary().handovers) == (1, 2)


def test_the_state_so_far_has_the_newest_and_the_mean_difference() -> None:
    watch = ShadowWatch({"avoider": ("other",)})
    for tick, theirs in enumerate([0.3, 0.5, 0.2]):
        say(watch, "main", True, tick, 0.3)
        say(watch, "other", False, tick, theirs)
    state = watch.finish()[0].so_far()
    assert (state.against, state.ticks, state.differing_share) == ("main", 3, pytest.approx(2 / 3))
    assert state.now["vx"] == pytest.approx(-0.1) and state.mean["vx"] == pytest.approx(0.1)
