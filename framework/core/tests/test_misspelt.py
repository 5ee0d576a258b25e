from navloom.misspelt import nearest


def test_a_name_that_is_known_twice_is_listed_once() -> None:
    assert nearest("xyz", ["vff", "dwa", "vff"]) == "; known are dwa, vff"
