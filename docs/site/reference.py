"""The reference, generated from the code: which page shows which names. tests/test_site.py holds it complete."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from importlib import import_module
from types import NoneType

import navloom
from navloom.messages import Message
from navloom.roles import ROLES, answers_of, given_of, verb_of
from tables import (
    command_sections,
    config_sections,
    key_table,
    metric_table,
    parameter_sections,
    plugin_table,
    sensor_sections,
    stream_table,
    world_tables,
)

__all__ = ["PAGES"]


def shown(*names: str, options: str = "") -> str:
    """Directives for mkdocstrings, one for each name."""
    return "\n\n".join(f"::: {name}{options}" for name in names)


def public(*names: str) -> str:
    """The same for names of `navloom` itself."""
    return shown(*(f"navloom.{name}" for name in names))


def messages_of(role: str) -> list[str]:
    """Messages that a role's verb answers with, and parts of them that are found in no other answer."""
    parts = {"Avoidance": ["AvoiderDiagnostics", "Rollouts"], "MapUpdate": ["OccupancyGrid"]}
    names = [one.__name__ for one in answers_of(role) if issubclass(one, Message)]
    return [name for answer in names for name in (answer, *parts.get(answer, ()))]


def role_page(role: str) -> str:
    """One role: its input struct, its class, and what answers."""
    cls = ROLES[role]
    name, verb = cls.__name__, verb_of(role)
    answer = inspect.signature(getattr(cls, verb)).return_annotation
    messages = ", ".join(f"[{message}](../messages.md#{message.lower()})" for message in messages_of(role))
    structs = [given_of(role).__name__]
    structs += [one.__name__ for one in answers_of(role) if not issubclass(one, (Message, NoneType))]
    return "\n\n".join((
        f"# {name}",
        f"`{verb}(self, given: {given_of(role).__name__}) -> {answer}`",
        cls.facts.called,
        *([f"Messages of the answer: {messages}."] if messages else []),
        "With `rate_hz` in its table, a plugin is called only in every n-th tick. "
        "[Checks](../writing-a-plugin.md#checks) lists what the framework checks in the answer, and "
        "[Plugins and their context](plugins.md) what a plugin's constructor gets.",
        public(*structs, name),
        "## Shipped",
        plugin_table(role),
    ))  # fmt: skip


def page(title: str, *parts: str) -> str:
    """A page of Markdown."""
    return "\n\n".join((f"# {title}", *parts))


def overview() -> str:
    """What is where."""
    rows = (
        ("input and answer of a role", "the page of the role, for example [Avoider](avoider.md)"),
        ("what a plugin's constructor gets: `Context`, `RobotSpec`, `Params`", "[plugins.md](plugins.md)"),
        ("every message, field by field", "[messages.md](../messages.md)"),
        ("a stream's message, quality of service and key", "[streams.md](streams.md)"),
        ("the keys of a config", "[config.md](config.md)"),
        ("a command's options", "[commands.md](commands.md)"),
        ("what may be imported", "[python.md](python.md)"),
    )
    return page(
        "Reference",
        "These pages are generated from the code when the site is built. Lengths are in m, angles in rad and "
        "counter-clockwise, times in s, unless a name ends in its unit (`stamp_ns`, `rate_hz`, `heading_deg`). In the "
        "base frame, x points forward and y to the left. A pose is that of base in the map frame.",
        table(("look for", "on"), rows),
    )


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of Markdown."""
    cells = [list(head)]
    lines = [cells[0], ["---"] * len(cells[0]), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def plugins_page() -> str:
    """What all plugins share."""
    return page(
        "Plugins and their context",
        "A plugin is made as `cls(params, context)`. `params` is an instance of its `Params`, checked against the "
        "config; `context` is a `Context`.",
        public(
            "Context",
            "RobotSpec",
            "SensorSpec",
            "Disturbance",
            "Params",
            "Derivable",
            "Derived",
            "LEFT_OUT",
            "Preset",
            "Role",
            "Extra",
            "Extras",
            "Claim",
            "InputError",
        ),
    )


def declaring_page() -> str:
    """How a message is declared."""
    return page(
        "Declare a message",
        "A message is a class with annotated fields and the decorator `@message`. "
        "[Messages of your own](../messages.md#messages-of-your-own) has an example.",
        public("message", "Message", "MessageError"),
        "## Kinds of fields",
        "A field is a `bool`, `int`, `float`, `str`, a `Literal` of strings, another message, a `tuple[X, ...]` of one "
        "of these, or an `Array`. Each may be `| None`.",
        public("Array", "Heading", "Positive", "NotNegative", "Unbounded", "Stamp", "Name", "Words", "Most"),
        "## Metadata of a message",
        public("Envelope"),
    )


def nodes_page() -> str:
    """Nodes without a role."""
    ports = ("PlatformPorts", "LocalizerPorts", "MapperPorts", "GoalPorts", "PlannerPorts", "ReferencePorts",
             "ControllerPorts", "AvoiderPorts", "RecoveryPorts", "GatePorts", "OperatorPorts")  # fmt: skip
    return page(
        "Nodes without a role",
        "[A whole node](../beyond-roles.md#a-whole-node) is a guide.",
        public("NodePlugin", "Tick", "Latest", "New", "Track", "Sensors", "Publishes", "Quality"),
        "## Ports of the framework's nodes",
        "An input may name one of these instead of a message class, as in `Latest(GatePorts.command)`. "
        "[Streams and keys](streams.md) lists their messages.",
        public(*ports),
    )


def metrics_page() -> str:
    """Metrics and panels."""
    return page(
        "Metrics and panels in Python",
        "[metrics.md](../metrics.md) defines the shipped metrics.",
        metric_table(),
        public("Metric", "Trail"),
        "## Panels of the viewer",
        "[A panel of your own](../viewing.md#a-panel-of-your-own) is a guide.",
        public("Panel", "Seen"),
        shown("navloom_viewer.Change"),
    )


def worlds_page() -> str:
    """Worlds, and what they are made of."""
    return page(
        "Worlds and schemes",
        "`[world] ref` of a config names a world, a file that ends in `.toml`, or `scheme:argument`.",
        world_tables(),
        "## A world file",
        shown("navloom.worlds.tomlfile", options="\n    options: { members: false, show_root_heading: false }"),
        "## An actor in a world file",
        shown("navloom.worlds.actor_tables", options="\n    options: { members: false, show_root_heading: false }"),
        "## A world in Python",
        public("World", "Box", "Cylinder", "Raster", "Place", "Actor", "Body", "Course", "Walk"),
        shown("navloom.geometry.grid.world_to_grid"),
    )


def streams_page() -> str:
    """Ports, quality of service and keys."""
    return page(
        "Streams and keys",
        "The table has the streams of the framework's nodes. In addition, each sensor of a config is a stream of the "
        "platform, with the name of the sensor, and a `[[node]]` has the streams that its class declares.",
        stream_table(),
        "**congestion**: what happens to a message when the link is full, within a host and between hosts: `drop` the "
        "message, `block` the publisher, or `block_first`: block for the first message and drop the ones after it. "
        "**retained**: late joiners get the last message. **required**: the robot does not drive without the active "
        "instance.",
        "## Keys",
        "A config's `[robot]` names realm and robot.",
        key_table(),
    )


def geometry_page() -> str:
    """Pure geometry."""
    modules = (
        "angles",
        "frames",
        "echoes",
        "cells",
        "footprints",
        "collision",
        "grid",
        "polylines",
        "solids",
    )
    return page(
        "Geometry",
        "Functions on numpy arrays. Import from the named module.",
        *(module(f"navloom.geometry.{name}") for name in modules),
    )


def avoidance_page() -> str:
    """What avoiders share."""
    modules = ("beams", "robot", "motors", "decision", "method", "search", "steering", "smoothing", "histogram",
               "clearance", "certainty", "support", "himm")  # fmt: skip
    return page(
        "Avoidance",
        "What several avoiders share: functions on numpy arrays. Import from the named module, "
        "also as `navloom.avoidance`.",
        *(module(f"navloom_avoidance.{name}") for name in modules),
    )


def drivers_page() -> str:
    """What drivers share."""
    return page(
        "Drivers",
        "What drivers of real robots share. Import from the named module. See "
        "[Write a driver](../writing-a-driver.md).",
        *(module(f"navloom.drivers.{name}") for name in ("link", "ports", "clocks")),
    )


def module(name: str) -> str:
    """A module with all that it exports."""
    return f"## {name}\n\n" + shown(name, options="\n    options: { show_root_heading: false, heading_level: 2 }")


def testing_page() -> str:
    """Builders and scenes."""
    return page(
        "Testing",
        "Import from `navloom.testing`.",
        shown("navloom_check.builders", options="\n    options: { show_root_heading: false }"),
        "## Messages",
        shown("navloom_check.messages", options="\n    options: { show_root_heading: false }"),
        "## Scenes",
        shown("navloom_check.scenes", options="\n    options: { show_root_heading: false }"),
        "## Samples and checks",
        shown("navloom_check.samples.sample", "navloom_check.runner.check_plugin"),
    )


def hooks_page() -> str:
    """The plugin door."""
    return page(
        "Hooks and the registry",
        "An entry point of the group `navloom` is named `KIND.NAME` and points to a module. "
        "[The entry point](../writing-a-plugin.md#the-entry-point) says what each kind registers.",
        public("hookimpl", "HookSpecs", "Registry", "RunInfo", "MessageObserver", "PluginError"),
        "## Discovery",
        public("Discovery", "PluginInfo"),
    )


def package(name: str) -> str:
    """A package with the classes and functions that it lists and `navloom` does not."""
    listed = {one: getattr(import_module(name), one) for one in import_module(name).__all__}
    documented = [one for one, thing in listed.items() if inspect.isroutine(thing) or inspect.isclass(thing)]
    names = [one for one in documented if one not in navloom.__all__ and one != "navloom_register"]
    return f"## {name}\n\n" + shown(*(f"{name}.{one}" for one in names))


def python_page() -> str:
    """What scripts use."""
    return page(
        "Python API",
        "A name without another package is imported from `navloom`. Messages are on their [own page](../messages.md).",
        "## A live robot",
        public("Navigator", "GoalHandle"),
        "`Navigator.listen` gives a `Listening`, which receives streams; each of its messages is a `Told`.",
        "## Roles and verbs",
        public("verb_of"),
        "## Worlds and arrays",
        public("read_only", "position_at"),
        "## Step records",
        public("StepRecord"),
        "## Errors",
        public("NavloomError"),
        "The names of other packages are public too: "
        "[What a distribution may import](../writing-a-plugin.md#what-a-distribution-may-import).",
        *map(package, PACKAGES),
    )


PACKAGES = (
    "navloom.cli",
    "navloom.config",
    "navloom.engine",
    "navloom.inputs",
    "navloom.runs",
    "navloom.worlds",
    "navloom_live",
    "navloom_maps",
    "navloom_recording",
    "navloom_study",
    "navloom_study.report",
    "navloom_viewer",
)
"""Public packages whose names are on the page of the Python API."""
PAGES: dict[str, Callable[[], str]] = {
    "index.md": overview,
    "plugins.md": plugins_page,
    **{f"{role}.md": lambda role=role: role_page(role) for role in ROLES},
    "nodes.md": nodes_page,
    "sensors.md": lambda: page("Sensors", sensor_sections()),
    "parameters.md": lambda: page("Parameters of the shipped plugins", parameter_sections()),
    "declaring.md": declaring_page,
    "streams.md": streams_page,
    "worlds.md": worlds_page,
    "metrics.md": metrics_page,
    "geometry.md": geometry_page,
    "avoidance.md": avoidance_page,
    "drivers.md": drivers_page,
    "testing.md": testing_page,
    "hooks.md": hooks_page,
    "config.md": lambda: page("Config", config_sections()),
    "commands.md": lambda: page("Command line", command_sections()),
    "python.md": python_page,
}
"""Each generated page, and what makes its text."""
