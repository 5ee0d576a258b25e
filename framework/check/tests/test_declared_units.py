"""Which descriptions of parameters and fields give a unit, or need none."""

import pytest
from navloom_check.contract.plugin_declarations import has_unit


@pytest.mark.parametrize(
    "text",
    [
        "Size of the mark, px.", "Gain of the amplifier, dB.", "Temperature of the motor, K.", "Variance, rad².",
        "Variance of the heading, rad^2.", "Noise of the encoder, counts.", "Part of the beams, 1.", "Slip, 1; or 0.",
        "Share of the beams that must fit.", "Likelihood of a false echo.", "Cosine of the incidence.",
        "Distance in standard deviations.", "Direction as a unit vector.",
    ],
)  # fmt: skip
def test_a_unit_or_a_quantity_without_one_is_known(text: str) -> None:
    assert has_unit(text)


@pytest.mark.parametrize(
    "text", ["Distance to keep.", "Speed in the open.", "The 1 distance to keep.", "Level of the tank."]
)
def test_a_distance_or_speed_without_a_unit_is_found(text: str) -> None:
    assert not has_unit(text)
