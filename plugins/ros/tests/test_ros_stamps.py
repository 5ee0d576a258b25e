"""Stamps of bags: clocks that stand, differ or jump, several sensors in one topic, and bags of several robots."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
import ros_bags as bags
from navloom.messages import Odometry, RangeScan
from navloom_recording.reader import Recording
from navloom_recording.recording_header import RecordingError
from navloom_ros.bag_import import Choice, import_bag
from navloom_ros.bag_outcome import Imported

SECOND = 10**9
Stamp = Callable[[int, int], int]
"""From the number of a message and its time, ns."""


def true(number: int, time_ns: int) -> int:
    return time_ns


def drive(folder: Path, odometry: Stamp = true, scan: Stamp = true, receipt: Stamp = true, count: int = 40) -> Path:
    """A drive at 0.5 m/s with a message of each kind every 0.1 s."""
    with bags.Bag(folder / "drive", 2) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", 0.2, 0.0, 0), receipt(0, bags.START_NS))
        for number in range(count):
            x, time_ns = 0.05 * number, bags.START_NS + number * SECOND // 10
            bag.put("/odom", bag.odometry(x, odometry(number, time_ns)), receipt(number, time_ns))
            bag.put("/scan", bag.scan(bags.ranges_at(x), scan(number, time_ns)), receipt(number, time_ns))
    return folder / "drive"


def imported(bag: Path, **choice: object) -> Imported:
    return import_bag(bag, bag.with_name("a.mcap"), choice=Choice(**choice))  # type: ignore[arg-type]


def counts(found: Imported) -> list[int]:
    return [topic.messages for topic in found.topics if topic.name in ("/odom", "/scan")]


@pytest.mark.parametrize(
    ("odometry", "scan", "why"),
    [
        (lambda i, t: 0, true, "/odom: its 40 messages all have the stamp 0; /scan: its stamps differ: take the times"),
        (true, lambda i, t: 0, "its 40 messages all have the stamp 0: take the times"),
        (true, lambda i, t: t // SECOND * SECOND, "its 40 messages have 4 different stamps: take the times"),
        (true, lambda i, t: t + 30 * SECOND, "its stamps are 30.0 s ahead of those of /odom: take the times"),
        (true, lambda i, t: t - 30 * SECOND, "its stamps are 30.0 s behind those of /odom: take the times"),
        (lambda i, t: t - bags.START_NS + 5 * SECOND, true, "its stamps are 18519 days ahead of those of /odom"),
    ],
)
def test_stamps_that_do_not_fit_are_refused_and_the_times_of_receipt_are_the_way_out(
    tmp_path: Path, odometry: Stamp, scan: Stamp, why: str
) -> None:
    bag = drive(tmp_path, odometry, scan)
    with pytest.raises(RecordingError) as refused:
        imported(bag)
    assert why in str(refused.value) and not (tmp_path / "a.mcap").exists()
    assert counts(imported(bag, by_receipt=True)) == [40, 40]
    stamps = {one.message.stamp_ns for one in Recording(tmp_path / "a.mcap").messages()}  # type: ignore[attr-defined]
    assert stamps == {bags.START_NS + number * SECOND // 10 for number in range(40)}


def reset(number: int, time_ns: int) -> int:
    """A simulation of 2.5 s, twice; the second one is cut short by the end of the bag."""
    return SECOND + number % 25 * SECOND // 10


def ntp(number: int, time_ns: int) -> int:
    return time_ns + (20_000_000 * SECOND if number >= 25 else 0)


@pytest.mark.parametrize(("jump", "receipt"), [(reset, true), (ntp, true), (ntp, ntp)])
def test_a_clock_that_jumps_cuts_the_log_into_runs(tmp_path: Path, jump: Stamp, receipt: Stamp) -> None:
    bag = drive(tmp_path, jump, jump, receipt)
    found = imported(bag)
    assert counts(found) == [25, 25] and found.last_ns - found.first_ns == 24 * SECOND // 10
    whole = ", or all with --stamps received" if receipt is true else ""
    jumps = f"the clock of /odom jumps: 2 runs, of 2.4 s, 1.4 s; run 1 is imported: take another with --run N{whole}"
    assert found.notes == [jumps]
    (tmp_path / "a.mcap").unlink()
    assert counts(imported(bag, run=2)) == [15, 15]
    poses = [one.message for one in Recording(tmp_path / "a.mcap").messages() if isinstance(one.message, Odometry)]
    assert poses[0].pose.x == pytest.approx(1.25)
    with pytest.raises(RecordingError, match=r"--run 3: the bag has 2"):
        imported(bag, run=3)


def test_a_single_stray_stamp_is_left_out(tmp_path: Path) -> None:
    found = imported(drive(tmp_path, scan=lambda i, t: t if i != 20 else t + 10**17))
    assert counts(found) == [40, 39]
    assert [dict(topic.skipped) for topic in found.topics if topic.name == "/scan"] == [{"a stray stamp": 1}]


def test_scans_that_were_processed_for_two_seconds_and_a_simulator_at_half_speed_fit(tmp_path: Path) -> None:
    simulated: Stamp = lambda i, t: SECOND + i * SECOND // 10  # noqa: E731
    for name, scan, receipt in (
        ("late", lambda i, t: simulated(i, t) - 2 * SECOND if i > 20 else simulated(i, t), true),
        ("slow", simulated, lambda i, t: bags.START_NS + i * SECOND // 5),
    ):
        (tmp_path / name).mkdir()
        assert counts(imported(drive(tmp_path / name, simulated, scan, receipt)))[0] == 40


def test_a_step_of_the_odometry_that_no_robot_drives_is_named(tmp_path: Path) -> None:
    with bags.Bag(tmp_path / "drive", 2) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", 0.2, 0.0, 0), bags.START_NS)
        for number in range(40):
            time_ns = bags.START_NS + number * SECOND // 10
            bag.put("/odom", bag.odometry(0.05 * number + (3.0 if number >= 20 else 0.0), time_ns), time_ns)
            bag.put("/scan", bag.scan([1.0, 2.0, 1.0], time_ns), time_ns)
    assert imported(tmp_path / "drive").notes == [
        "odometry: 1 step is beyond a robot's reach; the largest is 3.05 m and 0° in 0.10 s, at 2.0 s"
    ]


def test_two_lasers_in_one_topic_are_placed_by_their_own_frames(tmp_path: Path) -> None:
    with bags.Bag(tmp_path / "drive", 2) as bag:
        for frame, x in (("laser", 0.2), ("rear", -0.4)):
            bag.put("/tf_static", bag.transform("base_link", frame, x, 0.0, 0), bags.START_NS)
        for number in range(10):
            time_ns = bags.START_NS + number * SECOND // 10
            bag.put("/odom", bag.odometry(0.0, time_ns), time_ns)
            for frame in ("laser", "rear"):
                bag.put("/scan", bag.scan([1.0, 2.0, 1.0], time_ns, frame), time_ns)
    imported(tmp_path / "drive")
    scans = [one.message for one in Recording(tmp_path / "a.mcap").messages() if isinstance(one.message, RangeScan)]
    assert [scan.origins[0, 0] for scan in scans] == pytest.approx([0.2, -0.4] * 10)


def two_robots(folder: Path) -> Path:
    with bags.Bag(folder / "drive", 2) as bag:
        for robot, x in (("r1", 0.2), ("r2", -0.4)):
            bag.put(f"/{robot}/tf_static", bag.transform("base_link", "laser", x, 0.0, 0), bags.START_NS)
        for number in range(10):
            time_ns = bags.START_NS + number * SECOND // 10
            for robot, way in (("r1", 0.1), ("r2", -0.1)):
                bag.put(f"/{robot}/odom", bag.odometry(way * number, time_ns), time_ns)
                bag.put(f"/{robot}/scan", bag.scan([1.0, 2.0, 1.0], time_ns), time_ns)
    return folder / "drive"


def test_the_topics_of_one_of_two_robots_are_taken_by_its_namespace(tmp_path: Path) -> None:
    bag = two_robots(tmp_path)
    with pytest.raises(
        RecordingError, match=r"two poses of the frame laser, .* with --namespace NAME, or give --mount"
    ):
        imported(bag)
    imported(bag, namespace="/r2")
    messages = [one.message for one in Recording(tmp_path / "a.mcap").messages()]
    assert {scan.origins[0, 0] for scan in messages if isinstance(scan, RangeScan)} == {-0.4}
    assert [pose.pose.x for pose in messages if isinstance(pose, Odometry)][-1] == pytest.approx(-0.9)


def test_a_mount_that_moves_is_refused(tmp_path: Path) -> None:
    with bags.Bag(tmp_path / "drive", 2) as bag:
        for number in range(10):
            time_ns = bags.START_NS + number * SECOND // 10
            bag.put("/tf", bag.transform("base_link", "laser", 0.2, math.radians(3.0 * number), time_ns), time_ns)
            bag.put("/odom", bag.odometry(0.0, time_ns), time_ns)
            bag.put("/scan", bag.scan([1.0, 2.0, 1.0], time_ns), time_ns)
    with pytest.raises(RecordingError, match=r"the frame laser moves in base_link, by 0\.00 m and 3°, or give --mount"):
        imported(tmp_path / "drive")


@pytest.mark.parametrize("prefix", ["", "r1/"])
def test_a_transform_from_a_prefixed_odom_is_odometry(tmp_path: Path, prefix: str) -> None:
    with bags.Bag(tmp_path / "drive", 2) as bag:
        bag.put("/tf_static", bag.transform(f"{prefix}base_footprint", f"{prefix}laser", 0.2, 0.0, 0), bags.START_NS)
        for number in range(10):
            time_ns = bags.START_NS + number * SECOND // 10
            bag.put(
                "/tf", bag.transform(f"{prefix}odom", f"{prefix}base_footprint", 0.1 * number, 0.0, time_ns), time_ns
            )
            bag.put("/scan", bag.scan([1.0, 2.0, 1.0], time_ns, f"{prefix}laser"), time_ns)
    found = imported(tmp_path / "drive")
    assert {topic.name: (topic.sensor, topic.messages) for topic in found.topics} == {
        "/scan": ("scan", 10), "/tf": ("odometry", 10), "/tf_static": ("mounts", 1)
    }  # fmt: skip


def test_scans_without_odometry_are_followed_by_scan_odometry(
    tmp_path: Path, in_process: Callable[..., tuple[int, str, str]]
) -> None:
    """The robot drives 1.95 m along x; its odometry stands still."""
    with bags.Bag(tmp_path / "drive", 2) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", bags.MOUNT_X, bags.MOUNT_YAW, 0), bags.START_NS)
        for x, time_ns in bags.times():
            bag.put("/scan", bag.scan(bags.ranges_at(x), time_ns), time_ns)
    way_out = r"no odometry: .*; or import the scans alone, with --odom none, and follow its scans with `(.*)`$"
    with pytest.raises(RecordingError, match=way_out) as refused:
        imported(tmp_path / "drive")
    _, *command = str(refused.value).split("`")[1].split()
    found = import_bag(tmp_path / "drive", tmp_path / "a.mcap", odometry_topic="none")
    assert {topic.name: topic.messages for topic in found.topics} == {"/scan": 40, "/tf_static": 1}
    out = tmp_path / "o"
    code, _, errors = in_process(*command, "--out", str(out))
    assert code == 0, errors
    last = (out / "poses.csv").read_text("utf-8").splitlines()[-1].split(",")
    assert float(last[1]) == 0.0 and float(last[4]) == pytest.approx(1.95, abs=0.1)
