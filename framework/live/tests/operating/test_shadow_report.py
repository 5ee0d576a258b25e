from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from navloom.engine.shadow_state import ShadowState
from navloom.inputs.typed_json import from_json
from navloom_live.operating.shadow_report import COLUMNS, cells_of, differing_text, sizes_text

VFF = ShadowState(
    "avoider", "vff", against="improved_vfh", ticks=200, differing_share=0.345, stops=4,
    now={"vx": -0.1, "vy": 0.0, "wz": math.radians(12.0)}, mean={"vx": 0.05, "vy": 0.0, "wz": math.radians(3.0)},
)  # fmt: skip


@pytest.mark.parametrize("state", [VFF, ShadowState("avoider", "vff")])
def test_the_state_of_a_shadow_comes_back_from_the_wire_as_it_was(state: ShadowState) -> None:
    assert from_json(ShadowState, json.dumps(state.to_json())) == state


def test_a_shadow_is_one_row_with_units() -> None:
    expected = ("avoider vff", "improved_vfh", "200", "34 %", "-0.10 m/s, 12.0 deg/s", "0.05 m/s, 3.0 deg/s", "4 ticks")
    assert cells_of(VFF) == (*expected, "0 ticks")
    assert len(cells_of(ShadowState("avoider", "vff"))) == len(COLUMNS)


def test_the_line_of_a_shadow_leaves_out_what_never_happened() -> None:
    assert differing_text(VFF) == (
        "differs from improved_vfh in 34 % of 200 ticks; now -0.10 m/s, 12.0 deg/s; mean 0.05 m/s, 3.0 deg/s; "
        "would have stopped in 4 ticks"
    )
    assert differing_text(replace(VFF, ticks=0)) == "nothing to compare so far"
    assert differing_text(replace(VFF, ticks=None)) == "not compared"


def test_sizes_have_no_negative_zero_and_a_sideways_speed_only_where_there_is_one() -> None:
    assert sizes_text({"vx": -1e-5, "vy": 0.2, "wz": -1e-6}) == "0.00 m/s, 0.20 m/s sideways, 0.0 deg/s"
    assert sizes_text({"length": 0.25, "hausdorff": 0.1, "found": 0.0}) == "length 0.25 m, hausdorff 0.1 m, found 0"
    assert sizes_text({}) == "-"
