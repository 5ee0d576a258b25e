"""`navloom check` on shipped plugins and on names that do not exist."""

import json
import sys

METRIC = """
from navloom import Metric, hookimpl


@hookimpl
def navloom_register(registry):
    about = "Beyond its bounds."
    registry.metric(Metric("shares", "1", None, lambda trail: 2.0, about, bounds=(0.0, 1.0)))
"""

PANEL = """
from navloom import Contact, Panel, hookimpl


def draw(contact, seen):
    import rerun

    return []


@hookimpl
def navloom_register(registry):
    registry.panel(Panel("touch", Contact, draw))
"""


def test_a_panel_is_not_blamed_for_a_viewer_that_is_not_installed(in_process, tmp_path, monkeypatch):
    monkeypatch.setenv("NAVLOOM_PLUGIN_FILES", "[]")
    file = tmp_path / "touch.py"
    file.write_text(PANEL, "utf-8")
    # As on a host without the viewer, in the process of the check.
    (tmp_path / "rerun.py").write_text("raise ModuleNotFoundError('No module named rerun', name='rerun')", "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    code, out, _ = in_process("check", "panel.touch", "--plugin", str(file))
    assert code == 0 and out.count("pip install 'navloom[view]'") == 2
    assert "2 checks passed, 0 failed, 2 not run" in out


WAITS = """
from navloom import Avoidance, Avoider, AvoiderInput, Extra, Message, Twist2D, message


@message
class Load(Message):
    mass: float


class Waits(Avoider):
    name = "waits"
    load = Extra(Load)

    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(Twist2D(0.0, 0.0, 0.0), "clear")
"""


def test_a_claim_of_the_role_that_no_scene_can_test_is_no_pass(in_process, tmp_path, monkeypatch):
    monkeypatch.setenv("NAVLOOM_PLUGIN_FILES", "[]")
    file = tmp_path / "waits.py"
    file.write_text(WAITS, "utf-8")
    words = ("check", "avoider.waits", "--plugin", str(file), "--only")
    code, out, _ = in_process(*words, "no_contact")
    assert code == 1 and "cannot be tested: it waits for extra inputs that no scene has: load (Load)" in out
    assert "disclaims = {Claim.NO_CONTACT: REASON}" in out
    # What it does not claim is left out without a word of blame.
    assert in_process(*words, "mirror")[0] == 0


def test_a_shipped_controller_passes(in_process):
    code, out, err = in_process("check", "controller.lyapunov_tracker", "--tier", "contract", "--json")
    told = json.loads(out)
    assert (code, told["passed"]) == (0, True), err
    assert {result["outcome"] for result in told["results"]} <= {"passed", "not_run"}
    assert told["results"][0]["command"] == "navloom check controller.lyapunov_tracker --only registers --seed 0"


def test_a_plugin_that_is_not_installed_is_a_wrong_request(in_process):
    code, _, err = in_process("check", "avoider.improved_vhf")
    assert code == 2 and "did you mean 'improved_vfh'?" in err
    code, _, err = in_process("check", "avoider.vff", "--only", "repeat")
    assert code == 2 and "did you mean 'repeats'?" in err


def test_pictures_without_navloom_study_are_refused_before_anything_runs(in_process, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "navloom_study", None)
    out = tmp_path / "out"
    code, _, err = in_process("check", "avoider.vff", "--only", "no_contact", "--out", str(out))
    assert code == 2 and not out.exists()
    assert err == "navloom: --out needs navloom-study, which is not installed: pip install navloom-study\n"


def test_a_plugin_named_without_its_role_is_suggested_with_it(in_process):
    code, _, err = in_process("check", "improved_vfh")
    assert code == 2 and "did you mean 'avoider.improved_vfh'?" in err
    assert "known are" in in_process("check", "scheme")[2]


def test_a_world_that_a_scheme_reads_is_checked_as_a_world(in_process):
    code, out, err = in_process("check", "world.door:2.0")
    assert code == 0 and "ok      world_usable" in out and out.endswith("3 checks passed, 0 failed\n"), err
    code, out, _ = in_process("check", "world.door:-1")
    assert code == 1 and "raises WorldError" in out
    code, _, err = in_process("check", "scheme.door:2.0")
    assert code == 2 and "expected scheme.door, or world.door:2.0" in err
    assert "did you mean 'door'?" in in_process("check", "world.dor:2.0")[2]


def test_the_command_that_repeats_a_check_takes_the_same_plugin_file(in_process, tmp_path, monkeypatch):
    monkeypatch.setenv("NAVLOOM_PLUGIN_FILES", "[]")
    file = tmp_path / "shares.py"
    file.write_text(METRIC, "utf-8")
    code, out, _ = in_process("check", "metric.shares", "--plugin", str(file), "--only", "metric_values")
    assert code == 1
    assert f"repeat:  navloom check metric.shares --plugin {file} --only metric_values --seed 0" in out


def test_the_checks_are_listed_with_what_they_demand(in_process):
    code, out, _ = in_process("check", "--list", "--json")
    listed = json.loads(out)
    assert code == 0 and len({load["name"] for load in listed}) == len(listed) >= 15
    assert all(load["demands"] for load in listed)
