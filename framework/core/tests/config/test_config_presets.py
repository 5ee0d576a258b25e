"""Presets of a plugin's parameters in configs, options and `config show`."""

import pytest
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.effective_config import holding

VFH_L, VFH_L_ROBUST = 5, 1
"""Smoothing l as VFH prints it, and our default."""


def avoider(*changes, reference="paper", shadows=()):
    """Parameters of the active avoider of a config with changes."""
    system = assemble(load_config(reference, changes, shadows=shadows))
    return system.parts[("avoider", system.config.avoider.instance)].params


@pytest.mark.parametrize(
    "changes",
    [("avoider.plugin=vfh@printed",), ("avoider.plugin=vfh", "avoider.preset=printed"),
     ('avoider={plugin="vfh", preset="printed"}',), ('avoider={plugin="vfh@printed"}',)],
)  # fmt: skip
def test_both_spellings_give_the_printed_parameters(changes):
    assert avoider(*changes).smoothing == VFH_L


@pytest.mark.parametrize("name", ["vfh", "vfh@robust"])
def test_without_a_preset_and_with_robust_the_parameters_are_the_defaults(name):
    assert avoider(f"avoider.plugin={name}").smoothing == VFH_L_ROBUST


def test_keys_override_the_preset():
    params = avoider("avoider.plugin=vfh@printed", "avoider.smoothing=3")
    assert (params.smoothing, params.count_down) == (3, 0)


def test_two_presets_in_one_table_are_refused():
    with pytest.raises(ConfigError, match=r'plugin is "vfh@printed" and preset "robust", expected one preset'):
        load_config("paper", ['avoider={plugin="vfh@printed", preset="robust"}'])


def test_an_unknown_preset_is_refused_with_the_nearest_one():
    with pytest.raises(
        ConfigError, match=r'avoider.preset: avoider.vfh has no preset "printd"; did you mean \'printed\''
    ):
        avoider("avoider.plugin=vfh@printd")


def test_a_plugin_without_presets_says_so():
    with pytest.raises(ConfigError, match=r"recovery.wait_and_replan has no preset \"printed\"; it has none"):
        assemble(load_config("paper", ["recovery.plugin=wait_and_replan@printed"]))


def test_naming_the_plugin_alone_leaves_the_preset_of_the_file():
    loaded = load_config("paper", ["avoider.plugin=improved_vfh"])
    assert loaded.config.avoider.preset is None
    assert loaded.dropped == ("avoider.preset",)


def test_the_instance_is_named_as_it_is_typed():
    assert load_config("paper", ["avoider.plugin=vfh@printed"]).config.avoider.instance == "vfh@printed"
    assert load_config("paper", ["avoider.plugin=vfh"]).config.avoider.instance == "vfh"


def test_config_show_says_which_values_come_from_the_preset():
    rows = {place: (value, source) for place, value, source in
            holding(assemble(load_config("paper", ["avoider.plugin=vfh@printed", "avoider.count_up=2"])))}  # fmt: skip
    assert rows["avoider.preset"] == ("printed", "--set")
    assert rows["avoider.smoothing"] == (5, "preset printed")
    assert rows["avoider.count_up"] == (2, "--set")
    assert rows["avoider.patience"] == (60.0, "default")


def test_config_show_names_the_preset_that_the_defaults_are():
    rows = {place: (value, source) for place, value, source in holding(assemble(load_config("building")))}
    assert rows["avoider.preset"] == ("robust", "default")


def test_shadows_are_added_as_alternatives_with_presets():
    tables = load_config("paper", shadows=["avoider=vff,vfh@printed"]).config.alternative
    assert [(table.role, table.instance, table.shadow) for table in tables] == [
        ("avoider", "vff", True), ("avoider", "vfh@printed", True)]  # fmt: skip


def test_a_shadow_that_the_config_has_as_an_alternative_keeps_its_parameters():
    given = 'alternative=[{role="avoider", name="wary", plugin="vff", max_speed=0.2, shadow=false}]'
    (table,) = load_config("paper", [given], shadows=["avoider=wary"]).config.alternative
    assert (table.shadow, table.params) == (True, {"max_speed": 0.2})


@pytest.mark.parametrize(
    ("text", "message"),
    [("avoider", "expected ROLE=NAME,NAME"), ("avoider=", "expected ROLE=NAME,NAME"),
     ("avoidr=vff", "did you mean 'avoider'"),
     ("platform=sensors_sim", "no role 'platform' that can be shadowed"),
     ("avoider=improved_vfh@printed", "improved_vfh@printed is the active avoider")],
)  # fmt: skip
def test_a_wrong_shadow_is_one_message(text, message):
    with pytest.raises(ConfigError, match=message):
        load_config("paper", shadows=[text])


def test_an_unknown_plugin_in_shadow_names_the_option():
    with pytest.raises(ValueError, match=r"--shadow alternative\.0\.plugin: no plugin 'avoider.vf' is installed"):
        assemble(load_config("paper", shadows=["avoider=vf"]))
