"""Parameters that a plugin derives from the robot."""

from __future__ import annotations

from collections.abc import Mapping

from navloom import LEFT_OUT, Derivable, Derived, Params, RobotSpec
from navloom.roles.derived import filled, left_out
from navloom.testing import context, robot
from pydantic import Field
from toys import Chaser


class ReachParams(Params):
    reach: Derivable[float] = Field(LEFT_OUT, gt=0.0, description="m")
    gain: float = Field(1.0, description="no unit")


class Reaching(Chaser):
    """Its reach is the way of a second, times its gain."""

    Params = ReachParams

    @classmethod
    def derived(cls, params: ReachParams, robot: RobotSpec, period: float) -> Mapping[str, Derived]:
        return {"reach": Derived(params.gain * robot.max_linear, "gain and max_linear")}


def test_a_plugin_finds_derived_values_in_its_parameters() -> None:
    made = Reaching(ReachParams(gain=2.0), context(robot(max_linear=0.5)))
    assert made.params.reach == 1.0


def test_a_given_value_stays() -> None:
    made = Reaching(ReachParams(reach=0.3), context(robot(max_linear=0.5)))
    assert made.params.reach == 0.3


def test_a_changed_parameter_derives_the_others_again() -> None:
    """What was derived does not count as given: `set` events begin from the given values."""
    made = Reaching(ReachParams(gain=2.0), context(robot(max_linear=0.5)))
    made.configure(ReachParams(**{**made.params.model_dump(exclude_unset=True), "gain": 3.0}))
    assert made.params.reach == 1.5


def test_words_count_as_left_out() -> None:
    class Word(Params):
        radius: float | str = "inscribed"

    derived = {"radius": Derived(0.2, "footprint")}
    assert left_out(Word(radius=0.4), derived) == {}
    assert filled(Word(), derived).radius == 0.2
