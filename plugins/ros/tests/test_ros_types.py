"""Type hashes compared with those of ROS 2's own generators, and definitions from a user's folder."""

import re
from pathlib import Path

import pytest
from navloom_ros.errors import BadDefinition, UnknownType
from navloom_ros.message_types import Types
from ros_golden import DIFFERENT, HASHES, KILTED, OF_NAV2, WHEELS

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
MINE = "std_msgs/Header header\nPart[] parts\nfloat32[3] gains 1.0\nchar letter\nstring<=8 label\nbyte[<=4] flags\n"


def test_all_148_golden_hashes_are_ours():
    assert len(HASHES) == 148
    assert {name: KILTED.hash_of(name) for name in HASHES} == HASHES


def test_all_hashes_of_kilteds_wheels_are_ours_the_parts_of_services_too():
    theirs = WHEELS["hashes"]
    assert len(theirs) == 241 and sum("_Event" in name for name in theirs) > 20
    assert {name: KILTED.hash_of(name) for name in theirs} == theirs


@pytest.mark.parametrize("distribution", ["jazzy", "kilted", "lyrical"])
def test_hashes_of_nav2_and_tf2_are_those_of_the_distribution(distribution):
    types = Types(distribution)
    assert {name: types.hash_of(name) for name in OF_NAV2} == {name: of[distribution] for name, of in OF_NAV2.items()}


@pytest.mark.parametrize("distribution", DIFFERENT)
def test_other_distributions_differ_from_kilted_where_their_types_do(distribution):
    types = Types(distribution)
    assert {name for name in HASHES if not types.has(name) or types.hash_of(name) != HASHES[name]} == DIFFERENT[
        distribution
    ]


def test_humble_has_no_hashes_and_its_own_goals():
    humble = Types("humble")
    assert humble.hash_of("sensor_msgs/msg/Range") == "TypeHashNotSupported"
    assert [field for field, _ in humble.fields("nav2_msgs/action/NavigateToPose_Result")] == ["result"]
    assert "geometry_msgs/msg/PoseStamped" in str(humble.fields("nav2_msgs/action/NavigateThroughPoses_Goal"))
    assert "nav_msgs/msg/Goals" in str(KILTED.fields("nav2_msgs/action/NavigateThroughPoses_Goal"))
    assert "variance" not in dict(humble.fields("sensor_msgs/msg/Range"))


def test_the_readme_lists_every_type_of_kilted_without_a_golden_hash():
    listed = set(re.findall(r"`(\w+/(?:msg|srv|action)/\w+)`", README.partition("## Unverified")[2]))
    packages = set(re.findall(r"`(\w+)`: all", README.partition("## Unverified")[2]))
    parts = re.compile(r"_(Request|Response|Event|Goal|Result|Feedback|SendGoal|GetResult|FeedbackMessage)$")
    known = set(HASHES) | set(WHEELS["hashes"]) | set(OF_NAV2)
    unverified = {name for name in KILTED.names if name not in known and not parts.search(name)}
    assert listed | {name for name in unverified if name.split("/")[0] in packages} == unverified
    assert all(any(name.startswith(f"{package}/") for name in unverified) for package in packages)


def folder(tmp_path, **files):
    for name, text in files.items():
        kind = "srv" if text.count("---") == 1 else "action" if "---" in text else "msg"
        path = tmp_path / "mine_msgs" / kind / f"{name}.{kind}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    return tmp_path


def test_a_users_own_definitions_are_read_from_a_folder(tmp_path):
    types = Types("jazzy", [folder(tmp_path, Mine=MINE, Part="int64 id\n", Ask="Mine mine\n---\nbool done\n")])
    message = types.new("mine_msgs/msg/Mine", parts=[{"id": 7}], label="x", flags=[1, 2])
    again = types.decode("mine_msgs/msg/Mine", types.encode(message))
    assert (again.parts[0].id, again.label, list(again.flags), again.gains.shape) == (7, "x", [1, 2], (3,))
    assert types.hash_of("mine_msgs/srv/Ask").startswith("RIHS01_")
    assert types.encode(types.new("mine_msgs/srv/Ask_Request", mine=message))
    assert "MSG: mine_msgs/Part" in types.schema_of("mine_msgs/msg/Mine")


def test_an_action_of_ones_own_has_the_parts_that_ros_generates(tmp_path):
    types = Types("kilted", [folder(tmp_path, Dig="float32 depth\n---\nbool done\n---\nfloat32 left\n")])
    fields = {
        part: [name for name, _ in types.fields(f"mine_msgs/action/Dig_{part}")]
        for part in ("SendGoal_Request", "SendGoal_Response", "GetResult_Response", "FeedbackMessage")
    }
    assert fields == {
        "SendGoal_Request": ["goal_id", "goal"],
        "SendGoal_Response": ["accepted", "stamp"],
        "GetResult_Response": ["status", "result"],
        "FeedbackMessage": ["goal_id", "feedback"],
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Missing part\n", "field 'part' is of 'mine_msgs/msg/Missing', which is not known"),
        ("Bad again\n", "field 'again' is of 'mine_msgs/msg/Bad', which contains this type itself"),
        ("float32\n", "mine_msgs/msg/Bad: not a definition"),
        ("wstring name\n", "`wstring` is not supported; use `string`"),
        ("int8 a\nint16 a\n", "two fields have the same name"),
        ("int8 class\nint8 class_\n", "conflicting Python names"),
    ],
)
def test_a_definition_that_cannot_be_used_is_named(tmp_path, text, said):
    with pytest.raises(BadDefinition, match=said):
        Types("kilted", [folder(tmp_path, Bad=text)])


def test_types_that_contain_each_other_or_nest_too_deep_are_refused():
    with pytest.raises(BadDefinition, match="contains this type itself"):
        KILTED.add({"m/msg/A": "B b\n", "m/msg/B": "A[] a\n"})
    chain = {f"m/msg/C{index}": f"C{index + 1} next\n" for index in range(100)} | {"m/msg/C100": "int8 x\n"}
    with pytest.raises(BadDefinition, match="nested more than 64 levels"):
        KILTED.add(chain)
    assert not KILTED.has("m/msg/A")


def test_names_and_files_that_break_the_rules_are_refused(tmp_path):
    for name in ("Mine", "m/msg/mine", "m/idl/Mine", "m/msg/Mi'ne", 'm/msg/A"""'):
        with pytest.raises(BadDefinition, match="expected package/msg/Name"):
            KILTED.add({name: "int8 x\n"})
    with pytest.raises(BadDefinition, match=r"2 parts between lines of ---; a \.msg text has 1"):
        KILTED.add({"m/msg/Two": "int8 x\n---\nint8 y\n"})
    with pytest.raises(BadDefinition, match="no such folder"):
        Types("kilted", [tmp_path / "none"])
    with pytest.raises(BadDefinition, match="already present with different definition"):
        KILTED.add({"std_msgs/msg/Bool": "int8 data\n"})
    with pytest.raises(UnknownType, match="not known in kilted"):
        KILTED.hash_of("m/msg/Mine")
