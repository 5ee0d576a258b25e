"""`navloom check` on shipped plugins and on names that do not exist."""

import json


def test_a_shipped_controller_passes(in_process):
    code, out, err = in_process("check", "controller.lyapunov_tracker", "--tier", "contract", "--json")
    told = json.loads(out)
    assert (code, told["passed"]) == (0, True), err
    assert {one["outcome"] for one in told["results"]} <= {"passed", "not_run"}
    assert told["results"][0]["command"] == "navloom check controller.lyapunov_tracker --only registers --seed 0"


def test_what_is_not_installed_is_a_wrong_request(in_process):
    code, _, err = in_process("check", "avoider.improved_vhf")
    assert code == 2 and "did you mean 'improved_vfh'?" in err
    code, _, err = in_process("check", "avoider.vff", "--only", "repeat")
    assert code == 2 and "did you mean 'repeats'?" in err


def test_the_checks_are_listed_with_what_they_demand(in_process):
    code, out, _ = in_process("check", "--list", "--json")
    listed = json.loads(out)
    assert code == 0 and len({one["name"] for one in listed}) == len(listed) >= 15
    assert all(one["demands"] for one in listed)
