"""Draws what is known from the start: the world, the robots' bodies, names, colours and the legend."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from navloom.geometry.solids import box_corners, centre_at, is_present, overlaps
from navloom.geometry.world import Box, Cylinder, Obstacle, Raster

from navloom_viewer.colours import GREEN, STATES, WHITE, faded
from navloom_viewer.picture_setup import LANES, Actor, Facts, Variant, actors_of
from navloom_viewer.shapes import at_height, label, prism, rgba_cells

__all__ = ["bodies", "changing", "legend", "obstacles", "present", "series_styles", "standing", "state_styles"]

NAME = 0.7
"""Height of the labels of start and goal, m; lower ones would hide the marks."""
BEHIND = 0.7
"""Distance of the label of a start from it, m."""
METRICS = ("speed", "turn_rate", "clearance", "cross_track")


def standing(facts: Facts) -> Iterator[tuple[str, Any]]:
    """The static part of the world, and the world's raster."""
    if facts.world is not None:
        if facts.world.raster is not None:
            yield "/world/building", _raster(facts.world.raster)
        yield from obstacles(facts, [o for o in facts.world.obstacles if not _changes(o)], 0.0, "")


def changing(facts: Facts) -> list[Obstacle]:
    """Obstacles that move or appear later."""
    return [] if facts.world is None else [o for o in facts.world.obstacles if _changes(o)]


def obstacles(facts: Facts, chosen: Sequence[Obstacle], time: float, suffix: str) -> Iterator[tuple[str, Any]]:
    """Boxes and cylinders at a run time, s: those at the robot's height, and those above it."""
    import rerun as rr

    height = max(variant.height for variant in facts.variants)
    low = [o for o in chosen if overlaps(o.z, (0.0, height))]
    seen = [o for o in low if o.material != "glass"]
    groups = (
        ("in_the_way", (190, 190, 200, 110), [o for o in seen if o.is_mapped]),
        ("unmapped", (215, 120, 190, 130), [o for o in seen if not o.is_mapped]),
        ("glass", (90, 210, 235, 70), [o for o in low if o.material == "glass"]),
        ("overhead", (110, 170, 220, 40), [o for o in chosen if not overlaps(o.z, (0.0, height))]),
    )
    if suffix:
        tops = [(*centre_at(o, time), o.z[1] + 0.25) for o in low]
        yield f"/world/names{suffix}", label(tops, [o.name for o in low], (255, 200, 160, 255))
    for where, colour, here in groups:
        colour = (230, 120, 60, 150) if suffix else colour
        boxes = [o for o in here if isinstance(o, Box)]
        if boxes or suffix:
            yield f"/world/{where}{suffix}", _boxes(boxes, time, colour)
        rounds = [o for o in here if isinstance(o, Cylinder)]
        if rounds or suffix:
            centres = np.array([(*centre_at(o, time), 0.5 * (o.z[0] + o.z[1])) for o in rounds]).reshape(-1, 3)
            yield f"/world/{where}_round{suffix}", rr.Cylinders3D(
                lengths=[o.z[1] - o.z[0] for o in rounds], radii=[o.radius for o in rounds], centers=centres,
                colors=[colour], fill_mode=rr.components.FillMode.TransparentFillMajorWireframe, line_radii=0.006,
            )  # fmt: skip


def present(chosen: Sequence[Obstacle], time: float, sweep_ended: bool) -> list[Obstacle]:
    """The obstacles that have appeared."""
    return [o for o in chosen if is_present(o, time, sweep_ended)]


def bodies(facts: Facts) -> Iterator[tuple[str, str, Any]]:
    """Path, frame and shape of each robot and its label, and of the starts and goals."""
    actors = actors_of(facts)
    for variant in facts.variants:
        yield from _body(variant, actors[(variant.name, "", "")])
    yield from _places(facts)


def _body(variant: Variant, actor: Actor) -> Iterator[tuple[str, str, Any]]:
    import rerun as rr

    base, root, top = f"{variant.name}/base", f"/run/{variant.name}/base", variant.height
    vertices, triangles = prism(variant.footprint, top)
    shade = faded(actor.colour, 0.4)
    solid = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=shade)
    yield f"{root}/body", base, solid
    low, high = at_height(variant.footprint, 0.05), at_height(variant.footprint, top)
    posts = [np.stack(ends) for ends in zip(low, high, strict=True)]
    rings = [np.concatenate([ring, ring[:1]]) for ring in (low, high)]
    yield f"{root}/edges", base, rr.LineStrips3D(rings + posts, radii=0.012, colors=[actor.colour])
    ahead, origin = [float(variant.footprint[:, 0].max()) + 0.15, 0.0, 0.0], [0.0, 0.0, top + 0.02]
    front = rr.Arrows3D(vectors=[ahead], origins=[origin], radii=0.03, colors=[actor.colour])
    yield f"{root}/front", base, front
    if variant.has_truth:
        outline = at_height(np.concatenate([variant.footprint, variant.footprint[:1]]), 0.03)
        white = rr.LineStrips3D([outline], radii=0.008, colors=[(255, 255, 255, 200)])
        yield f"/run/{variant.name}/true_outline", f"{variant.name}/true", white


def _places(facts: Facts) -> Iterator[tuple[str, str, Any]]:
    """Marks of starts and goals; equal ones of several robots are drawn once."""
    import rerun as rr

    starts = {(v.start.x, v.start.y): v.start.heading for v in facts.variants}
    for number, ((x, y), heading) in enumerate(sorted(starts.items())):
        yield f"/world/start/{number}", "map", rr.Points3D([[x, y, 0.03]], radii=0.1, colors=[GREEN])
        # Behind the start, nearer to the camera: above it is the name of the robot that has not left yet.
        behind = (x - BEHIND * np.cos(heading), y - BEHIND * np.sin(heading), 0.0)
        yield f"/world/start/{number}/name", "map", label([behind], ["start"], WHITE)
    goals = {(*v.goal, v.goal_tolerance) for v in facts.variants if v.goal is not None}
    turns = np.linspace(0.0, 2.0 * np.pi, 33)
    for number, (x, y, radius) in enumerate(sorted(goals)):
        ring = at_height(np.column_stack([np.cos(turns), np.sin(turns)]) * radius + (x, y), 0.09)
        yield f"/world/goal/{number}", "map", rr.LineStrips3D([ring], radii=0.025, colors=[GREEN])
        yield f"/world/goal/{number}/name", "map", label([(x, y, NAME)], ["goal"], WHITE)


def series_styles(facts: Facts) -> Iterator[tuple[str, Any]]:
    """Name, colour and width of each line of the time series."""
    import rerun as rr

    single = len(facts.variants) == 1
    for actor in actors_of(facts).values():
        colour, width = (faded(actor.colour, 0.6), 1.0) if actor.is_shadow else (actor.colour, 2.0)
        for metric in METRICS:
            name = f"{actor.name} (shadow)" if actor.is_shadow else actor.name
            yield f"/metrics/{metric}/{actor.name}", rr.SeriesLines(colors=[colour], widths=[width], names=[name])
            if single and not actor.is_shadow and metric in ("speed", "turn_rate"):
                yield (
                    f"/metrics/{metric}/{actor.name}_command",
                    rr.SeriesLines(colors=[(200, 200, 200, 255)], widths=[1.0], names=["commanded"]),
                )


def state_styles(facts: Facts) -> Iterator[tuple[str, Any]]:
    """Colours of the lanes of the state timeline."""
    import rerun as rr

    values = list(STATES)
    colours = [(r << 24) | (g << 16) | (b << 8) | a for r, g, b, a in STATES.values()]
    for actor in actors_of(facts).values():
        for lane in LANES[-1:] if actor.is_shadow else LANES:
            path = actor.lane(lane, len(facts.variants) == 1)
            yield path, rr.StateConfiguration(values=values, labels=values, colors=colours)


def legend(facts: Facts) -> str:
    """The meaning of colours and lines, as Markdown."""
    single = len(facts.variants) == 1
    lines = [f"# {facts.title}", ""]
    actors = actors_of(facts)
    for variant in facts.variants:
        roles = ", ".join(f"{role} *{name}*" for role, name in variant.plugins.items() if role != "platform")
        lines.append(f"- **{variant.name}**, {_word(actors[(variant.name, '', '')])}: {roles}")
        for role, instance in variant.shadows:
            lines.append(f"- {role} **{instance}**, {_word(actors[(variant.name, role, instance)])}, thin: alternative")
    lines += ["", "| line or mark | meaning |", "|---|---|"]
    if single:
        lines += [
            "| orange line | plan |", "| blue line | trajectory; the dot is the point steered to |",
            "| vermilion line | driven |", "| white line ahead | what the next 2 s of the command lead to |",
        ]  # fmt: skip
    else:
        lines += [
            "| a robot's colour | its plan and trajectory (thin), what it drove (thick), what its map holds |",
            "| a striped line | the same plan, trajectory or outline of several robots |",
        ]
    lines += [
        "| white outline on the floor | where the simulator knows the robot to be |",
        "| arrow from a robot's middle | direction its avoider chose |",
        "| white arrow above a robot | where the command of the active instance leads, if its role has a shadow |",
        "| arrow with a name | where the command of a shadow leads |",
        "| density | of obstacles by bearing, deg, left at the left, in units of the threshold: above 1 is blocked |",
    ]
    lines.append(
        "| seconds beside a robot's name, and on its map | run clock at which they were published: what stays behind "
        "the time below is old |"
    )
    if single:
        lines += [
            "| blue cones | sonar echoes; grey: no echo |",
            "| ring round the robot | polar histogram: vermilion blocked, green free; inner green arc: a free slot |",
            "| square with orange to red cells | certainty window of the avoider |",
            "| light, slate and black floor | the robot's own map: free, unknown and occupied |",
            "| red points | kept for the map: nearest obstacle on their bearing |",
            "| pale orange, grey, blue points | behind the nearest; floor; overhead, above the robot |",
            "| translucent boxes | the true world: pink is unmapped, light blue glass; orange ones appear or move |",
        ]
    return "\n".join(lines)


_WORDS = {"56B4E9": "sky blue", "E69F00": "orange", "009E73": "green", "CC79A7": "pink", "F0E442": "yellow",
          "D55E00": "vermilion", "0072B2": "blue"}  # fmt: skip


def _word(actor: Actor) -> str:
    return _WORDS["{:02X}{:02X}{:02X}".format(*actor.colour[:3])]


def _changes(obstacle: Obstacle) -> bool:
    return bool(obstacle.waypoints) or obstacle.appears_after_sweep or obstacle.appears_at > 0.0


def _boxes(boxes: Sequence[Box], time: float, colour: tuple[int, int, int, int]) -> Any:
    import rerun as rr

    corners = [box_corners(box, time) for box in boxes]
    centres = [(*c.mean(axis=0), 0.5 * (box.z[0] + box.z[1])) for c, box in zip(corners, boxes, strict=True)]
    halves = [(0.5 * (b.x[1] - b.x[0]), 0.5 * (b.y[1] - b.y[0]), 0.5 * (b.z[1] - b.z[0])) for b in boxes]
    turns = [rr.RotationAxisAngle([0.0, 0.0, 1.0], radians=box.yaw) for box in boxes]
    return rr.Boxes3D(
        centers=np.array(centres).reshape(-1, 3), half_sizes=np.array(halves).reshape(-1, 3),
        rotation_axis_angles=turns, colors=[colour], radii=0.006,
        fill_mode=rr.components.FillMode.TransparentFillMajorWireframe,
    )  # fmt: skip


def _raster(raster: Raster) -> Any:
    import rerun as rr

    colours = np.zeros((*raster.occupied.shape, 4), dtype=np.uint8)
    colours[raster.occupied] = (150, 150, 160, 255)
    image, cols, rows = rgba_cells(colours)
    return rr.GridMap(
        data=image,
        format=rr.components.ImageFormat(width=cols, height=rows, color_model="RGBA", channel_datatype="U8"),
        cell_size=raster.resolution,
        opacity=0.99,
        rotation_axis_angle=rr.RotationAxisAngle([0.0, 0.0, 1.0], radians=raster.origin.heading),
        translation=[raster.origin.x, raster.origin.y, -0.02],
    )
