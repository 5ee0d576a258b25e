"""Each README's tables of parameters and presets are those of the plugins."""

import pytest
from navloom.plugins import Discovery
from preset_tables import PLUGINS, plugins_with_presets, section, tables

FOUND = plugins_with_presets(Discovery())


@pytest.mark.parametrize("folder", FOUND)
def test_readme_lists_every_parameter_and_preset(folder):
    _, inside, _ = section((PLUGINS / folder / "README.md").read_text("utf-8"))
    assert inside.strip() == tables(FOUND[folder]).strip(), "run python tests/preset_tables.py"


def test_methods_that_are_compared_have_both_presets():
    both = {cls.name for classes in FOUND.values() for cls in classes if {"robust", "printed"} <= set(cls.presets)}
    assert both >= {"vff", "vfh", "vfh_plus", "vfh_star", "dwa", "improved_vfh", "kanayama", "fierro_lewis", "ramsete",
                    "pure_pursuit", "regulated_pure_pursuit", "graceful"}  # fmt: skip


@pytest.mark.parametrize("folder", FOUND)
def test_every_printed_value_names_its_place_or_the_decision(folder):
    for cls in FOUND[folder]:
        for preset in cls.presets.values():
            assert all(why.strip() for _, why in preset.settings.values()), cls.name
