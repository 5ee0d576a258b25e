"""Valid files to mutate, as small as possible, and functions that correct the checksums of mutated ones."""

from __future__ import annotations

import io
import json
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any, Literal
from unittest.mock import patch

import numpy as np
import zstandard
from navloom.config import load_config
from navloom.messages import Envelope, Odometry, Pose2D, Twist2D
from navloom.messages.codec import encode, schema_label
from navloom_recording.recording_header import header_of
from navloom_recording.writer import RecordingWriter
from PIL import Image

__all__ = [
    "CARMEN", "RAW_CARMEN", "CONFIG", "IDENTITIES", "JOURNAL", "MAP", "OVERRIDES", "REQUEST", "SMALL_CONFIG", "STUDY",
    "TABLE", "WORLD", "YAML", "bag_seeds", "barn", "npz_with_checksums", "png", "png_with_checksums", "recordings",
    "sweep",
]  # fmt: skip

IDENTITIES = b'{"realm": "lab", "robot": "r1", "identities": [{"name": "a", "kind": "viewer", "instance": ""}]}'
STUDY = b'{"methods": {"a": {}}, "metrics": [], "worlds": {"w": {}}, "seeds": [1], "open_loop": {"baseline": "a"}}'
TABLE = "method,world,seed,outcome,reason,trace_sha256\na,w,1,succeeded,reached,ab\n"
"""Table of the episodes of that study."""
OVERRIDES = [
    b"controller.k3=1.0",
    b'planner.plugin="theta_star"',
    b"sensor.laser.beams=91",
    b"navigation.goal={ x = 1.0, y = 2.0 }",
    b"mapper={plugin='union'}",
    b"robot.footprint.length=1.5e0",
    b"navigation.speed=[0.2, 0.4]",
]
"""Values of `--set`."""
REQUEST: dict[str, Any] = {
    "metrics": ["success", "spl"],
    "open_loop": {"baseline": "a", "shadows": {"vff_1": "b"}, "left_out": {}},
}
"""Request of the study that the journal belongs to."""
SIZES = {"linear": {"rms": 0.1, "max": 0.2}}
SHADOW = {
    "role": "avoider", "instance": "vff_1", "against": ["a"], "ticks": 9, "unanswered": 0, "differing_share": 0.5,
    "first_differing_tick": 3, "first_differing_s": 0.1, "differences": SIZES,
    "driving": {"ticks": 2, "differing_share": None, "differences": SIZES},
}  # fmt: skip
EPISODES: list[dict[str, Any]] = [
    {"method": "a", "world": "paper", "seed": 1, "outcome": "succeeded", "reason": "",
     "metrics": {"success": 1.0, "spl": None}, "trace_sha256": "ab", "timing": {"wall_s": 0.5, "late": False},
     "notes": ["x"]},
    {"method": "(open loop)", "world": "paper", "seed": 1, "outcome": "stuck", "reason": "trapped", "metrics": {},
     "trace_sha256": "", "timing": {}, "notes": [], "shadows": [SHADOW]},
]  # fmt: skip
JOURNAL = b"".join(json.dumps(episode).encode() + b"\n" for episode in EPISODES)
YAML = (
    b"{image: m.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, free_thresh: 0.2, mode: raw}"
)
MAP = b"type octile\nheight 2\nwidth 4\nmap\n.GS.\n@OTW\n"
WORLD = b"""bounds = [-5.0, -1.0, 5.0, 9.0]
start = { x = 0.0, y = 0.0, heading_deg = 90.0 }
goal = { x = 0.0, y = 7.6 }
goal_tolerance = 0.2
[[box]]
name = "cupboard"
x = [1.0, 1.6]
y = [2.0, 2.4]
yaw_deg = 30.0
[[cylinder]]
x = 0.5
y = 3.0
radius = 0.25
appears = "after_sweep"
[[cylinder]]
x = 1.5
y = 3.0
radius = 0.25
waypoints = [[5.0, 0.5, 3.0], [9.0, 2.5, 3.0]]
loops = true
"""
CONFIG = b"""[robot]
name = "r1"
footprint = { length = 0.8, width = 0.6 }
[run]
seed = 3
period = 0.05
[world]
ref = "paper_gates"
[navigation]
goal = { x = 0.0, y = 7.6 }
[planner]
plugin = "astar"
[controller]
plugin = "lyapunov_tracker"
k1 = 1.0
k3 = 0.6
[[sensor]]
name = "laser"
kind = "range_scan"
beams = 181
"""


SMALL_CONFIG = b"""world.ref = "paper_gates"
navigation.goal = { x = 0.0, y = 7.6 }
[[sensor]]
name = "laser"
kind = "range_scan"
"""


def png(mode: str) -> bytes:
    file = io.BytesIO()
    Image.new(mode, (40, 30), 1).save(file, "PNG")
    return file.getvalue()


def png_with_checksums(content: bytes) -> bytes:
    """The PNG with correct checksums of its chunks, so that readers reach their contents."""
    out, at = content[:8], 8
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        body = content[at + 4 : at + 8 + length]
        out += content[at : at + 4] + body + struct.pack(">I", zlib.crc32(body))
        at += 12 + length
    return out + content[at:]


def npz(**arrays: Any) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, np.asarray(array))
            archive.writestr(f"{name}.npy", member.getvalue())
    return file.getvalue()


def npz_with_checksums(content: bytes) -> bytes:
    """The archive with correct checksums of its members; unchanged if its members cannot be listed."""
    content = bytearray(content)
    try:
        entries = zipfile.ZipFile(io.BytesIO(bytes(content))).infolist()
    except Exception:
        return bytes(content)
    at = bytes(content).find(b"PK\x01\x02")
    for entry in entries:
        if at < 0 or entry.compress_type != zipfile.ZIP_STORED:
            break
        start = entry.header_offset + 30 + len(entry.filename)
        content[at + 16 : at + 20] = struct.pack("<I", zlib.crc32(content[start : start + entry.file_size]))
        at = bytes(content).find(b"PK\x01\x02", at + 4)
    return bytes(content)


def barn() -> bytes:
    return npz(world=[1, 2], cyl=np.ones((3, 3)), cyl_off=[0, 2, 3], start=np.zeros(3), goal=np.zeros(2),
               goal_tol=1.0, time_limit=9.0, path_len_m=[8.0, 9.0])  # fmt: skip


def sweep() -> bytes:
    pitches, bearings = np.radians(np.linspace(-60, 0, 30)), np.radians(np.linspace(-40, 40, 41))
    down = -np.sin(pitches)[:, None] + 0.0 * bearings
    ranges = np.where(down > 0.1, 0.6 / np.maximum(down, 0.1), 6.0)
    return npz(ranges_m=ranges, pitch_deg=np.degrees(pitches), beam_deg=np.degrees(bearings))


CARMEN = b"""# a comment
PARAM robot_frontlaser_offset 0.1 nohost 0
ODOM 0 0 0 0.2 0 0 1.0 nohost 0.1
FLASER 4 1 2 3 81.8 0 0 0 0 0 0 1.1 nohost 0.2
ODOM 0.1 0 0 0.2 0 0 1.2 nohost 0.3
NEFF 12
ROBOTLASER1 0 -1.57 3.14 1.57 80 0.01 0 3 1 2 3 1 7 0.1 0 0 0.1 0 0 0.2 0 0 0 0 1.3 nohost 0.4
RLASER 2 1 2 0 0 3.14 0 0 0 1.4 nohost 0.5
"""
RAW_CARMEN = CARMEN.replace(b"NEFF 12\n", b"")
"""The log without the marks of corrected poses."""


def recordings(folder: Path) -> list[bytes]:
    """A small recording: closed, truncated, and with uncompressed chunks so that mutations reach their contents."""
    path = folder / "r.mcap"
    writer = RecordingWriter(path, header_of(load_config("paper"), "lockstep", {}), {})
    with writer:
        for number in range(1, 6):
            at = Envelope("lab/r1/platform/main/odometry", number, number, number * 10**7, number * 10**7, 0)
            message = Odometry(at.stamp_ns, Pose2D(0.1 * number, 0.0, 0.0), Twist2D(0.5, 0.0, 0.0))
            writer.add(at.key, schema_label(Odometry), encode(message, at), at.stamp_ns, at.stamp_ns, number)
        writer.close({"messages": 5})
    whole = path.read_bytes()
    plain, at = whole[:8], 8
    while at + 9 <= len(whole):
        opcode, length = struct.unpack_from("<BQ", whole, at)
        content, at = whole[at + 9 : at + 9 + length], at + 9 + length
        if opcode == 6:
            (size,) = struct.unpack_from("<Q", content, 16)
            (how,) = struct.unpack_from("<I", content, 28)
            data = zstandard.ZstdDecompressor().decompress(content[40 + how :], max_output_size=size)
            content = content[:24] + bytes(4) + bytes(4) + struct.pack("<Q", len(data)) + data
        plain += struct.pack("<BQ", opcode, len(content)) + content
        if opcode == 2:
            break
    plain += whole[:8]
    return [plain, plain, whole, plain[: len(plain) // 2]]


def bag_seeds(folder: Path) -> dict[str, list[bytes]]:
    """Small bags of each kind, by file name: with scans, and with a cloud, a sonar and odometry from transforms."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "plugins" / "ros" / "tests"))
    import ros_bags as bags
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    def mcap_writer(path: Path, version: Literal[8, 9]) -> Writer2:
        return Writer2(path, version=version, storage_plugin=StoragePlugin.MCAP)

    found = {}
    with patch.multiple(bags, SECONDS=0.3, BEAMS=9):
        plain = bags.room_bag(folder / "a.bag", 1), _sensor_bag(folder / "sensors.bag", 1)
        found["x.bag"] = [bag.read_bytes() for bag in plain]
        made = bags.room_bag(folder / "b", 2), _sensor_bag(folder / "sensors", 2)
        found["x.db3"] = [database.read_bytes() for bag in made for database in bag.glob("*.db3")]
        with patch.object(bags, "Writer2", mcap_writer):
            made = bags.room_bag(folder / "c", 2), _sensor_bag(folder / "sensors_mcap", 2)
        found["x.mcap"] = [recorded.read_bytes() for bag in made for recorded in bag.glob("*.mcap")]
        with bags.Bag(folder / "d", 2) as bag:
            bag.put("/odom", bag.odometry(0.0, bags.START_NS), bags.START_NS)
    return found


def _sensor_bag(path: Path, ros: int) -> Path:
    import ros_bags as bags

    points = [[2.0, y, z] for z in (0.0, 0.4) for y in (-0.2, 0.0, 0.2)]
    with bags.Bag(path, ros) as bag:
        bag.put("/tf_static", bag.transform("base_link", "laser", 0.2, 0.0, bags.START_NS), bags.START_NS)
        for x, stamp_ns in bags.times():
            bag.put("/tf", bag.transform("odom", "base_link", x, 0.1, stamp_ns), stamp_ns)
            bag.put("/cloud", bag.cloud(points, 2, stamp_ns), stamp_ns)
            bag.put("/sonar", bag.range(1.5, stamp_ns), stamp_ns)
    return path
