"""`navloom map`: makes a map from one recorded sweep."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer
from navloom.cli.options import PluginFiles, a_number

__all__ = ["map_recording"]


def map_recording(
    file: Annotated[Path, typer.Argument(metavar="SWEEP", help=".npz with ranges_m, pitch_deg and beam_deg.")],
    mapper: Annotated[str, typer.Option(metavar="NAME", help="Mapper plugin.")] = "ipabd",
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=V", help="A parameter of the mapper; repeats.")
    ] = None,
    plugin: PluginFiles = None,
    pitch_offset: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Added to the pitches; default: estimated from the floor.", callback=a_number),
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(
            metavar="M", help="Of the sensor above the floor; default: estimated from the floor.", callback=a_number
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for map.png, map.yaml, result.json.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Map one recorded sweep of a pitched laser.

    Without --out nothing is written.
    """
    from navloom.cli.output import print_json, print_table
    from navloom.cli.written_files import tell_out
    from navloom.runs.result_folder import MAP, OutFolder

    from navloom_study.recorded_sweeps import find_floor, map_sweep, read_recording, sweep_of

    with OutFolder(out, ("result.json", "map.png", *MAP)) as folder:
        recording = read_recording(file)
        if pitch_offset is None or height is None:
            found_offset, found_height = find_floor(recording)
            pitch_offset = math.degrees(found_offset) if pitch_offset is None else pitch_offset
            height = found_height if height is None else height
        mapped = map_sweep(sweep_of(recording, math.radians(pitch_offset), height), mapper=mapper, changes=set_ or ())
        result: dict[str, Any] = {
            "points": mapped.sweep.ranges.size,
            "counts": mapped.counts(),
            "segments": len(mapped.update.segments),
            "pitch_offset_deg": pitch_offset,
            "height_m": height,
            "mapper_ms": mapped.mapper_ms,
        }
        if out is not None:
            folder.write(_files(mapped, result))
            folder.write_map(mapped.update.grid)
    if as_json:
        print_json(result)
    else:
        typer.echo(f"{result['points']} points to {result['segments']} segments in {mapped.mapper_ms:.2f} ms")
        typer.echo(f"sensor {height:.3f} m above the floor, pitch {pitch_offset:+.2f} deg off")
        print_table(("points", "use"), [(value, name) for name, value in mapped.counts().items()])
    raise typer.Exit(0 if tell_out(folder, as_json) else 1)


def _files(mapped: Any, result: dict[str, Any]) -> dict[str, bytes]:
    import json

    from navloom_study.report.plotting import png_of
    from navloom_study.report.run_picture import draw_map_update

    text = json.dumps(result, indent=2) + "\n"
    return {"result.json": text.encode(), "map.png": png_of(draw_map_update(mapped.update))}
