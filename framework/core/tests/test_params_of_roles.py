"""The type parameter of a role sets `Params` and types `self.params`; without it, `Params` is an attribute."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any, TypeVar

import pytest
from navloom import Avoidance, Avoider, AvoiderInput, NodePlugin, Params, Planner, Tick
from pydantic import Field


class GapParams(Params):
    clearance: float = Field(0.5, gt=0.0, description="Free space beside the robot, m.")


class WideParams(GapParams):
    width: int = Field(3, ge=1, description="Beams of the narrowest gap.")


P = TypeVar("P", bound=GapParams)


class Base(Avoider[P]):
    def avoid(self, given: AvoiderInput) -> Avoidance:
        return Avoidance(given.desired, "clear")


class Gap(Base[GapParams]):
    name = "gap"


class Wide(Base[WideParams]):
    name = "wide"


class Narrower(Wide):
    name = "narrower"


class Plain(Planner):
    name = "plain"


class Named(Planner):
    name = "named"
    Params = GapParams


class Listener(NodePlugin[GapParams]):
    name = "listener"
    ticks = True

    def step(self, tick: Tick) -> None:
        """Does nothing."""


@pytest.mark.parametrize(
    ("cls", "params"),
    [(Gap, GapParams), (Wide, WideParams), (Narrower, WideParams), (Plain, Params), (Named, GapParams),
     (Listener, GapParams), (Base, Params)],
)  # fmt: skip
def test_params_come_from_the_parameter_or_the_attribute(cls: Any, params: type[Params]) -> None:
    assert cls.Params is params


SOURCE = """
from typing import Any, assert_type

from navloom import Avoidance, Avoider, AvoiderInput, Context, Params


class GapParams(Params):
    clearance: float = 0.5


class Gap(Avoider[GapParams]):
    name = "gap"

    def avoid(self, given: AvoiderInput) -> Avoidance:
        assert_type(self.params, GapParams)
        assert_type(self.params.clearance, float)
        return Avoidance(given.desired, self.params.clearence)


class Old(Avoider):
    name = "old"
    Params = GapParams

    def __init__(self, params: GapParams, context: Context) -> None:
        super().__init__(params, context)

    def avoid(self, given: AvoiderInput) -> Avoidance:
        assert_type(self.params, Any)
        return Avoidance(given.desired, "clear")
"""


@pytest.mark.once
def test_mypy_knows_the_params_and_accepts_a_role_without_its_parameter(tmp_path: Path) -> None:
    source = tmp_path / "gap.py"
    source.write_text(SOURCE, "utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(source)]
    said = subprocess.run(command, capture_output=True, text=True).stdout.splitlines()
    assert len(said) == 1, said
    assert '"GapParams" has no attribute "clearence"' in said[0] and "gap.py:17:" in said[0]
