"""Draws maps, sweeps and range scans."""

from __future__ import annotations

import numpy as np
from navloom.geometry.echoes import beam_ends, poses_along
from navloom.messages import MapUpdate, RangeScan, Sweep, Tracks
from numpy.typing import NDArray

from navloom_viewer.colours import CLOUD, GREY, PURPLE, SKY, WHITE, faded
from navloom_viewer.panels import Drawn, Seen
from navloom_viewer.shapes import at_height, cones, label, rgba_cells, stripes
from navloom_viewer.sweep_classes import CLASSES, classify_sweep, sweep_points

__all__ = ["BLENDED", "map_update", "range_scan", "sweep", "tracks"]

FREE, OCCUPIED, UNKNOWN = (226, 228, 230), (12, 13, 16), (92, 104, 122)
"""Colours of cells: unknown lies between the others, so that neither looks like the dark background."""
BLENDED = 0.99
"""Opacity of a whole grid; at 1 the viewer ignores the opacity of the cells."""
UNIMPORTANT = 20000
"""Most points of one class that are drawn; the class `kept` is drawn completely."""
BEAM_HEIGHT = 0.25
"""Height at which planar scans are drawn, m above the floor; messages do not contain the sensor's height."""
OF_CLOUD = {"kept": 0.028, "behind": 0.014, "floor": 0.008, "overhead": 0.012, "below": 0.02}
"""Radius of the points of each class, m."""
BODY = 0.5
"""Half the height of what stands for a person, m."""
UNSEEN = 0.3
"""Age of the last echo from which a body is drawn faintly, s: longer than the time between scans."""


def map_update(message: MapUpdate, seen: Seen) -> Drawn:
    """Draw cells, dark if occupied and slate if unknown, and outlines; for shadows or several robots outlines."""
    import rerun as rr

    if seen.is_alone and not seen.actor.is_shadow:
        grid = message.grid
        image, cols, rows = rgba_cells(_cell_colours(grid.cells))
        layout = rr.components.ImageFormat(width=cols, height=rows, color_model="RGBA", channel_datatype="U8")
        turn = rr.RotationAxisAngle([0.0, 0.0, 1.0], radians=grid.origin.heading)
        yield seen.in_map("map"), rr.GridMap(
            data=image, format=layout, cell_size=grid.resolution, rotation_axis_angle=turn,
            translation=[grid.origin.x, grid.origin.y, 0.0], opacity=BLENDED,
        )  # fmt: skip
        corner = (grid.origin.x, grid.origin.y, 0.1)
        yield seen.in_map("map_age"), label([corner], [f"map of {seen.time:.0f} s"], WHITE)
    share = (0, 1) if seen.actor.is_shadow else seen.stripe
    lines = [at_height(piece, 0.08) for ends in message.segments.reshape(-1, 2, 2) for piece in stripes(ends, *share)]
    own = CLOUD["kept"] if seen.is_alone and not seen.actor.is_shadow else faded(seen.actor.colour, 0.5)
    yield seen.in_map("segments"), rr.LineStrips3D(lines, radii=0.03, colors=[own])


def sweep(message: Sweep, seen: Seen) -> Drawn:
    """Draw the point cloud, coloured by the mapper's classes; not for several robots, whose maps suffice."""
    import rerun as rr

    if not seen.is_alone or seen.actor.is_shadow:
        return
    times = message.stamp_ns * 1e-9 + message.frame_times
    track = seen.track
    poses = poses_along(times, track[:, 0], track[:, 1:]) if len(track) else None
    rule = seen.robot.sweep_rule
    points = sweep_points(message, rule, poses)
    classes = classify_sweep(message, rule, poses)
    for number, name in enumerate(CLASSES):
        if name == "none":
            continue
        chosen = points[classes == number]
        if name != "kept" and len(chosen) > UNIMPORTANT:
            # Rounded up, so that it is never more.
            chosen = chosen[:: -(-len(chosen) // UNIMPORTANT)]
        shape = rr.Points3D(chosen.astype(np.float32), radii=OF_CLOUD[name], colors=[CLOUD[name]])
        yield seen.in_map(f"sweep/{name}"), shape


def range_scan(message: RangeScan, seen: Seen) -> Drawn:
    """Draw sonar cones up to their echo, faint without one, and laser returns as points; not for several robots."""
    import rerun as rr

    if not seen.is_alone or seen.actor.is_shadow:
        return
    echo = message.ranges < message.range_max
    is_cone = message.half_angles > 0.0
    if is_cone.any():
        # A cone without an echo is drawn to a third of its range, which is enough to show its direction.
        shown = np.where(echo, message.ranges, 0.33 * message.range_max)[is_cone]
        outlines = cones(
            message.origins[is_cone], message.bearings[is_cone], message.half_angles[is_cone], shown, BEAM_HEIGHT
        )
        strong, faint = faded(SKY, 0.9), faded(GREY, 0.25)
        colours = [strong if heard else faint for heard in echo[is_cone]]
        yield seen.in_base(seen.port), rr.LineStrips3D(outlines.astype(np.float32), radii=0.008, colors=colours)
    if not is_cone.all():
        hits = echo & ~is_cone
        points = beam_ends(message.origins[hits], message.bearings[hits], message.ranges[hits])
        cloud = np.column_stack([points, np.full(len(points), BEAM_HEIGHT)]).astype(np.float32)
        yield seen.in_base(f"{seen.port}_returns"), rr.Points3D(cloud, radii=0.02, colors=[SKY])


def tracks(message: Tracks, seen: Seen) -> Drawn:
    """Draw each body as a disc with its number and the way of its next second; faint where it is not seen now."""
    import rerun as rr

    colour = seen.actor.colour if seen.actor.is_shadow or not seen.is_alone else PURPLE
    colours = [faded(colour, 0.3 if unseen > UNSEEN else 0.8) for unseen in message.unseen]
    centres = at_height(message.positions, BODY)
    halves = np.column_stack([message.radii, message.radii, np.full(len(message.radii), BODY)])
    labels = [str(number) for number in message.ids]
    yield seen.in_map("tracks"), rr.Ellipsoids3D(centers=centres, half_sizes=halves, colors=colours, labels=labels)
    ways = at_height(message.velocities, 0.0)
    yield seen.in_map("tracks/velocity"), rr.Arrows3D(vectors=ways, origins=centres, radii=0.03, colors=colours)


def _cell_colours(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    """(rows, cols, 4) RGBA: from light to dark by occupancy, slate where unknown."""
    share = np.clip(cells, 0, 100)[..., None] / 100.0
    colours = np.empty((*cells.shape, 4), dtype=np.uint8)
    colours[..., :3] = np.round(np.array(FREE) * (1.0 - share) + np.array(OCCUPIED) * share)
    colours[cells < 0, :3] = UNKNOWN
    colours[..., 3] = 255
    return colours
