"""Which instances a running robot cannot gain, and what it becomes when it gains one."""

from __future__ import annotations

import pytest
from navloom.config import ConfigError, load_config
from navloom.engine.build import assemble
from navloom.engine.system import System
from navloom.roles import Role
from navloom_live.hosting.addition_service import AdditionError, refuse_addition
from navloom_live.hosting.system_extension import admit_part, extended, with_alternative
from navloom_live.live.live_node_builder import all_sources
from navloom_live.live.node_placement import spread

VFF = ("avoider", "vff")
TABLE = {"role": "avoider", "plugin": "vff", "name": "vff", "shadow": True}
HOSTS = (
    'live.hosts={ one = ["robot", "think"], two = ["drive", "safe"] }', 'live.router="tcp/127.0.0.1:7447"',
)  # fmt: skip


def paper(*changes: str) -> System:
    return assemble(load_config("paper", changes))


def test_a_robot_on_one_host_can_gain_any_role_but_a_platform() -> None:
    refuse_addition(paper(), VFF, barrier=False)
    with pytest.raises(AdditionError, match="'platform' is no role that can be swapped"):
        refuse_addition(paper(), ("platform", "sensors_sim"), barrier=False)
    with pytest.raises(AdditionError, match="did you mean 'avoider'"):
        refuse_addition(paper(), ("avoidr", "vff"), barrier=False)


def test_under_the_barrier_and_on_several_hosts_the_refusal_says_how_to_start_with_it() -> None:
    with pytest.raises(AdditionError, match="start it with `navloom up paper --shadow avoider=vff --barrier`"):
        refuse_addition(paper(), VFF, barrier=True)
    with pytest.raises(AdditionError, match="`navloom up paper --shadow avoider=vff --host NAME` on each host"):
        refuse_addition(paper(*HOSTS), VFF, barrier=False)


def test_every_process_computes_the_same_config_and_the_instance_has_a_process_of_its_own() -> None:
    system, told = paper(), paper()
    loaded = with_alternative(system.loaded, TABLE, "avoider-vff")
    grown = extended(system, loaded, VFF)
    admit_part(told, with_alternative(told.loaded, TABLE, "avoider-vff"), VFF)
    assert told.loaded.sha256() == grown.loaded.sha256() != system.loaded.sha256()
    assert all_sources(told) == all_sources(grown)
    assert spread(told.config, all_sources(told), None)["avoider-vff"] == (VFF,)
    assert told.parts[VFF].cls is Role  # its plugin was not imported


def test_an_instance_that_makes_another_node_read_something_new_is_refused() -> None:
    kinds = {"laser": "pitched_laser", "sonars": "sonar_ring", "lidar": "laser_2d"}
    sensors = ", ".join(f'{{ name = "{name}", kind = "{kind}" }}' for name, kind in kinds.items())
    system = paper(f"sensor=[{sensors}]", 'avoider.sensors=["sonars"]')
    with pytest.raises(ConfigError, match=r"gate main would have to watch platform.lidar too"):
        extended(system, with_alternative(system.loaded, TABLE, "avoider-vff"), VFF)
