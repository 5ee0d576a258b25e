"""`navloom plugins ROLE` describes the input of a role's plugins."""

import json

import pytest
from navloom.roles import ROLES, verb_of


@pytest.mark.parametrize("role", ROLES)
def test_a_role_is_described_with_every_field_and_its_meaning(in_process, role):
    code, out, _ = in_process("plugins", role, "--json")
    told = json.loads(out)
    assert code == 0 and told["verb"].startswith(f"{verb_of(role)}(self, given: ")
    assert {"given", "self.context", "self.context.robot"} <= told["fields"].keys()
    fields = [field for rows in told["fields"].values() for field in rows]
    assert [field["name"] for field in fields if not field["meaning"]] == []


def test_the_description_of_the_avoider(in_process):
    code, out, _ = in_process("plugins", "avoider")
    assert code == 0
    assert "avoid(self, given: AvoiderInput) -> Avoidance" in out
    assert "Point to steer to, m, map frame." in out and "improved_vfh" in out


def test_a_plugin_named_without_its_role_is_suggested_with_it(in_process):
    code, _, err = in_process("plugins", "improved_vfh")
    assert code == 2 and "did you mean 'avoider.improved_vfh'?" in err
    assert "did you mean 'avoider'?" in in_process("plugins", "avoidr")[2]
