"""Commands that look into a live robot: list, status, echo, hz, doctor."""

from __future__ import annotations

import json
import time
from typing import Annotated, Any

import typer

from navloom.cli.live_options import AsJson, Connect, Insecure, Keys, RobotName

__all__ = ["doctor", "echo", "hz", "list_nodes", "status"]

VIEWER = "viewer"
"""Certificate that is enough to look."""


def list_nodes(
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Print every node of a live robot with its process, host and state."""
    from navloom.cli.output import print_json, print_table
    from navloom.runtime.joining import join
    from navloom.runtime.looking import listing

    with join(robot, connect, keys, VIEWER, insecure) as client:
        nodes = listing(client)
    if as_json:
        print_json([{key: value for key, value in node.items() if key != "streams"} for node in nodes])
        return
    rows = []
    for node in nodes:
        if not node["answers"]:
            rows.append((node["role"], node["instance"], None, None, None, None, "does not answer", None))
            continue
        state = "in charge" if node["active"] else "shadow" if node["enabled"] else "waits"
        rows.append(
            (node["role"], node["instance"], node["plugin"], node["process"], node["pid"], node["host"],
             state + (", busy" if node.get("busy") else ""), node["tick"])
        )  # fmt: skip
    print_table(("role", "instance", "plugin", "process", "pid", "host", "state", "tick"), rows)


def status(
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Print what a live robot is doing: its goal, who drives, and why it stands."""
    from navloom.cli.output import print_json, print_table
    from navloom.runtime.joining import join
    from navloom.runtime.looking import last_words, listing, message_fields

    with join(robot, connect, keys, VIEWER, insecure) as client:
        nodes, words = listing(client), last_words(client)
        name = client.keys.prefix
    feedback, gate = words["goal/feedback"], words["gate/status"]
    clock = max((node["clock_ns"] for node in nodes if node["answers"]), default=-1)
    found: dict[str, Any] = {
        "robot": name,
        "run_clock_s": clock * 1e-9 if clock >= 0 else None,
        "nodes": len(nodes),
        "silent_nodes": [f"{node['role']} {node['instance']}" for node in nodes if not node["answers"]],
        **{key.replace("/", "_"): None if word is None else message_fields(word) for key, word in words.items()},
    }
    if as_json:
        print_json(found)
        return
    rows = [("robot", name), ("run clock, s", found["run_clock_s"]), ("nodes", len(nodes))]
    if found["silent_nodes"]:
        rows.append(("do not answer", ", ".join(found["silent_nodes"])))
    rows.append(("goal", _goal_text(feedback)))
    rows.append(("drives", _gate_text(gate)))
    if words["goal/result"] is not None:
        result = found["goal_result"]
        rows.append(("last goal", f"{result['goal_id']}: {result['outcome']}, {result['reason']}"))
    print_table(("", ""), rows)


def echo(
    key: Annotated[str, typer.Argument(metavar="KEY", help="role/port or role/instance/port, with * for any.")],
    fields: Annotated[str | None, typer.Option(metavar="A.B,C", help="Only these fields.")] = None,
    count: Annotated[int | None, typer.Option(metavar="N", min=1, help="End after N messages.")] = None,
    whole: Annotated[bool, typer.Option("--whole", help="Arrays whole instead of summarised.")] = False,
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Print the messages of a stream as they come, until Ctrl-C."""
    from navloom.runtime.joining import join
    from navloom.runtime.looking import envelope_fields, listing, message_fields, resolve, tap
    from navloom.runtime.mailbox import Mailbox

    with join(robot, connect, keys, VIEWER, insecure) as client:
        mailbox = Mailbox()
        taps = tap(client, resolve(key, listing(client)), mailbox)
        seen = printed = 0
        try:
            while count is None or printed < count:
                seen = mailbox.wait(seen, 0.2)
                for stream, inlet in taps.items():
                    for message, envelope in inlet.take():
                        if count is not None and printed >= count:
                            break
                        printed += 1
                        values = _chosen(message_fields(message, whole), fields)
                        _print_message(stream, envelope_fields(envelope), values, as_json)
        except KeyboardInterrupt:
            return


def hz(
    key: Annotated[str, typer.Argument(metavar="KEY", help="role/port or role/instance/port, with * for any.")],
    seconds: Annotated[float, typer.Option("--for", metavar="S", min=0.1, help="s to listen.")] = 3.0,
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Print rate, jitter, age and bandwidth of streams. Ages count from the platform's stamp a message derives from."""
    from navloom.cli.output import print_json, print_table
    from navloom.runtime.joining import join
    from navloom.runtime.looking import StreamMeter, listing, resolve, tap
    from navloom.runtime.mailbox import Mailbox
    from navloom.runtime.run_clock import RunClock

    with join(robot, connect, keys, VIEWER, insecure) as client:
        nodes = listing(client)
        names, clock, mailbox = resolve(key, nodes), RunClock(), Mailbox()
        [odometry] = resolve("platform/odometry", nodes)
        taps = tap(client, sorted({*names, odometry}), mailbox)
        meters = {name: StreamMeter() for name in names}
        limit, seen = time.monotonic() + seconds, 0
        while time.monotonic() < limit:
            seen = mailbox.wait(seen, 0.05)
            for name in (odometry, *(name for name in names if name != odometry)):
                for packet in taps[name].packets():
                    opened = packet.try_open()
                    if name == odometry and opened is not None:
                        clock.observe(opened[1].stamp_ns, packet.arrived_ns, opened[1].tick)
                    if name in meters:
                        meters[name].note(packet, clock.now_ns())
    found = {name: meter.summary(seconds) for name, meter in meters.items()}
    if as_json:
        print_json(found)
        return
    columns = (
        "stream",
        "Hz",
        "jitter, ms",
        "longest gap, ms",
        "age p50, ms",
        "age p99, ms",
        "kB/s",
        "lost",
        "malformed",
    )
    rows = [
        (name, one["rate_hz"], _ms(one["jitter_std_s"]), _ms(one["interval_max_s"]), _ms(one["age_p50_s"]),
         _ms(one["age_p99_s"]), one["bytes_per_s"] / 1e3, one["lost"], one["malformed"])
        for name, one in found.items()
    ]  # fmt: skip
    print_table(columns, rows)


def doctor(
    robot: RobotName = None,
    connect: Connect = None,
    keys: Keys = None,
    insecure: Insecure = False,
    as_json: AsJson = False,
) -> None:
    """Find what is wrong with a live robot, and say what to do. Exit 0: nothing."""
    from dataclasses import asdict

    from navloom.cli.output import print_json
    from navloom.runtime.doctor import Finding, examine
    from navloom.runtime.joining import join
    from navloom.runtime.zenoh_bus import BusError

    try:
        with join(robot, connect, keys, VIEWER, insecure) as client:
            name, found = client.keys.prefix, examine(client)
    except BusError as error:
        name = robot or "robot"
        remedy = (
            "is its router up (`navloom router`), is the endpoint right, and is tls/ used on both sides or on none?"
        )
        found = [Finding(str(error), remedy)]
    if as_json:
        print_json({"robot": name, "findings": [asdict(finding) for finding in found]})
    elif not found:
        typer.echo(f"{name}: nothing is wrong")
    else:
        for finding in found:
            typer.echo(f"{finding.what}\n    {finding.remedy}")
    raise typer.Exit(1 if found else 0)


def _goal_text(feedback: Any) -> str:
    if feedback is None or not feedback.goal_id:
        return "none"
    return f"{feedback.goal_id}: {feedback.state}, {feedback.distance:.2f} m, {feedback.time_left:.0f} s left"


def _gate_text(gate: Any) -> str:
    if gate is None:
        return "nobody: no gate has spoken"
    if not gate.stopped:
        return f"{gate.source} {gate.instance}"
    remedy = "; `navloom resume` lets it drive" if gate.latched else ""
    return f"nobody: {gate.reason}{remedy}"


def _chosen(values: dict[str, Any], fields: str | None) -> dict[str, Any]:
    """Only the fields named, by dotted path."""
    if fields is None:
        return values
    found = {}
    for path in fields.split(","):
        value: Any = values
        for name in path.strip().split("."):
            if not isinstance(value, dict) or name not in value:
                raise typer.BadParameter(f"--fields {path}: there is no {name!r}; there are {', '.join(values)}")
            value = value[name]
        found[path.strip()] = value
    return found


def _print_message(stream: str, envelope: dict[str, Any], values: dict[str, Any], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps({"stream": stream, "envelope": envelope, "message": values}))
    else:
        head = f"{stream}  tick {envelope['tick']}  sequence {envelope['sequence']}"
        typer.echo(head + "\n" + "\n".join(f"  {name}: {json.dumps(value)}" for name, value in values.items()))


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else seconds * 1e3
