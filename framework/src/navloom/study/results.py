"""The folder a run leaves: whole files or none."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from navloom.config import ConfigError
from navloom.study.episode import Episode
from navloom.study.shadows import shadow_table

__all__ = ["ResultFolder"]

WRITTEN = ("trace.bin", "result.json", "run.png", "shadows.csv")


class ResultFolder:
    """Keeps result.json, trace.bin, run.png, the map and, of shadows, shadows.csv, each moved there when it is whole.

    Without a folder nothing is written. A run that fails leaves an existing folder as it was.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.trace: IO[bytes] | None = None
        self.names: list[str] = []
        self._made = False

    def __enter__(self) -> ResultFolder:
        if self.folder is not None:
            self._made = not self.folder.exists()
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                self.trace = self._draft("trace.bin").open("wb")
            except OSError as error:
                raise ConfigError(f"--out {self.folder}: cannot be written: {error.strerror}; name a folder") from None
        return self

    def keep(self, episode: Episode, summary: dict[str, Any]) -> None:
        """Write everything about a finished run."""
        if self.folder is None or self.trace is None:
            return
        from navloom.geometry.grid import GridMap
        from navloom.geometry.world import Place
        from navloom.study.picture import draw_run
        from navloom.worlds.rosmap import save_rosmap

        self.trace.close()
        self._draft("result.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")
        draw_run(episode).save(self._draft("run.png"), format="PNG")
        if episode.shadows:
            self._draft("shadows.csv").write_bytes(shadow_table(episode.shadows).encode())
        for name in WRITTEN[: None if episode.shadows else -1]:
            os.replace(self._draft(name), self.folder / name)
            self.names.append(name)
        if episode.recorder.map is not None:
            grid = episode.recorder.map.grid
            origin = Place(grid.origin.x, grid.origin.y, grid.origin.heading)
            save_rosmap(GridMap(grid.cells, grid.resolution, origin), self.folder / "map.yaml")
            self.names += ["map.yaml", "map.pgm"]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.folder is None or self.trace is None:
            return
        self.trace.close()
        for name in WRITTEN:
            self._draft(name).unlink(missing_ok=True)
        if self._made and not any(self.folder.iterdir()):
            self.folder.rmdir()

    def _draft(self, name: str) -> Path:
        assert self.folder is not None
        return self.folder / f".{name}.part"
