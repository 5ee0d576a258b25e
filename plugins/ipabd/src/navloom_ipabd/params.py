"""Parameters of the ipabd mapper, as a config file gives them, and its presets."""

from __future__ import annotations

from math import inf, radians
from typing import Literal

from navloom import Params, Preset
from pydantic import Field

from navloom_ipabd.mapping import MapSettings
from navloom_ipabd.rules import FilterOrder, Filters, HeightFrame
from navloom_ipabd.segmentation import Segmentation, SegmentationMethod

__all__ = ["PRINTED", "ROBUST", "IpabdParams", "UnionParams"]


class IpabdParams(Params):
    """Parameters of `ipabd`. Lengths in m, angles in degrees. The README gives the source of each default."""

    geometry: Literal["as_sweep", "paper", "rigid_pitch"] = Field(
        "as_sweep", description="how ranges become points; as_sweep: as the sweep states"
    )
    filter_order: FilterOrder = Field("before_min", description="floor and height filter before or after the minimum")
    height_frame: HeightFrame = Field(
        "floor", description="where z is 0 in the filters: at the floor, or at the sensor (eq. (1) as printed)"
    )
    floor_tolerance: float = Field(
        0.06, ge=0.0, description="largest distance from the floor of points that count as floor, m"
    )
    z_limit: float | None = Field(
        None, gt=0.0, description="height above which points are ignored, m; default: the robot's height"
    )
    min_range: float = Field(
        0.0, ge=0.0, description="shorter ranges are outliers, m, in addition to the sensor's limit"
    )
    max_range_tolerance: float = Field(
        0.05, ge=0.0, description="ranges this close to the sensor's maximum are no returns, m"
    )
    deskew: bool = Field(True, description="correct each frame for the robot's movement")
    track_slack: float = Field(0.2, ge=0.0, description="how far the pose track may miss the sweep's ends, s")
    bin_width_deg: float | None = Field(None, gt=0.0, le=30.0, description="azimuth bins; default: the bearing step")

    segmentation: SegmentationMethod = Field("adaptive", description="threshold that separates objects")
    incidence_deg: float = Field(10.0, gt=0.0, lt=90.0, description="λ of adaptive")
    range_sigma: float = Field(0.02, ge=0.0, description="σ of adaptive, m")
    segmentation_noise: float = Field(0.1, ge=0.0, description="C0 of dietmayer and santos, m")
    santos_beta_deg: float = Field(15.0, gt=0.0, lt=90.0, description="β of santos")
    lee_limit: float = Field(0.05, gt=0.0, description="largest ratio of lee, no unit")
    max_missing: int = Field(2, ge=0, description="largest number of empty columns within an object")
    line_tolerance: float = Field(0.06, gt=0.0, description="T of split and merge, m")

    cell: float = Field(0.40, gt=0.0, description="edge of a grid cell, m")
    anchor: tuple[float, float] | None = Field(None, description="a cell centre, m, map frame; default: the start")
    extent: tuple[float, float, float, float] | None = Field(
        None, description="lowest x, y, highest x, y of the map, m; default: the area seen, and the anchor"
    )
    raster: Literal["distance", "supercover", "paper"] = Field("distance", description="which cells a line occupies")
    paper_raster_t: float = Field(0.8, gt=0.0, description="T of the printed slope test (a length, m, or no unit)")
    free_range: float = Field(
        20.0, gt=0.0, description="distance from the sensor beyond which no cell is marked free, m"
    )
    accumulate: bool = Field(True, description="keep the map between sweeps; false: the latest sweep only")

    def settings(self, robot_height: float, start: tuple[float, float]) -> MapSettings:
        """Settings of the pure modules, in SI units and radians.

        Args:
            robot_height: Height of the robot, m; the default of `z_limit`.
            start: x, y, m, map frame; the default of `anchor`.
        """
        filters = Filters(
            floor_tolerance=self.floor_tolerance,
            z_limit=robot_height if self.z_limit is None else self.z_limit,
            frame=self.height_frame,
            order=self.filter_order,
            min_range=self.min_range,
            max_range_tolerance=self.max_range_tolerance,
        )
        parting = Segmentation(
            method=self.segmentation,
            incidence=radians(self.incidence_deg),
            sigma=self.range_sigma,
            noise=self.segmentation_noise,
            santos_beta=radians(self.santos_beta_deg),
            lee_limit=self.lee_limit,
            max_missing=self.max_missing,
        )
        return MapSettings(
            filters=filters,
            segmentation=parting,
            line_tolerance=self.line_tolerance,
            resolution=self.cell,
            anchor=self.anchor or start,
            extent=self.extent,
            free_range=self.free_range,
            raster=self.raster,
            paper_t=self.paper_raster_t,
            bin_width=None if self.bin_width_deg is None else radians(self.bin_width_deg),
        )


ROBUST = Preset("ours: the geometry that the sweep states")

PRINTED = Preset(
    "Hoang et al. 2013, II.B",
    {
        "geometry": ("paper", "II.B, eq. (1), whatever the sensor measures"),
        "filter_order": (
            "before_min",
            "II.B prints step 3 after step 2, which maps no bearing; decided: filters first",
        ),
        "height_frame": (
            "floor",
            "II.B prints z = 0 for the floor, which is at -0.4 m by eq. (1); decided: from the floor",
        ),
        "floor_tolerance": (0.06, "II.B: z = 0; decided: six standard deviations of the laser"),
        "z_limit": (None, "II.B: the robot's height"),
        "deskew": (True, "not in the paper, whose robot stands; decided: it does no harm there"),
        "segmentation": (
            "adaptive",
            "II.B: PDBS; its threshold is not stated; decided: the adaptive breakpoint detector",
        ),
        "line_tolerance": (0.06, "not stated; decided: six standard deviations of the laser"),
        "accumulate": (True, "not in the paper, which takes one image; decided: another one adds to the map"),
    },
)


class UnionParams(Params):
    """Parameters of `union`: those of `ipabd` that do not concern the minimum or the lines, and `keeps_floor`."""

    geometry: Literal["as_sweep", "paper", "rigid_pitch"] = Field(
        "as_sweep", description="how ranges become points; as_sweep: as the sweep states"
    )
    keeps_floor: bool = Field(True, description="press the floor like everything else, as in Fig. 7")
    floor_tolerance: float = Field(
        0.06, ge=0.0, description="largest distance from the floor of points that count as floor, m"
    )
    z_limit: float | None = Field(
        None, gt=0.0, description="height above which points are ignored, m; default: no limit"
    )
    min_range: float = Field(
        0.0, ge=0.0, description="shorter ranges are outliers, m, in addition to the sensor's limit"
    )
    max_range_tolerance: float = Field(
        0.05, ge=0.0, description="ranges this close to the sensor's maximum are no returns, m"
    )
    deskew: bool = Field(True, description="correct each frame for the robot's movement")
    track_slack: float = Field(0.2, ge=0.0, description="how far the pose track may miss the sweep's ends, s")
    bin_width_deg: float | None = Field(None, gt=0.0, le=30.0, description="azimuth bins; default: the bearing step")
    cell: float = Field(0.40, gt=0.0, description="edge of a grid cell, m")
    anchor: tuple[float, float] | None = Field(None, description="a cell centre, m, map frame; default: the start")
    extent: tuple[float, float, float, float] | None = Field(
        None, description="lowest x, y, highest x, y of the map, m; default: the area seen, and the anchor"
    )
    free_range: float = Field(
        20.0, gt=0.0, description="distance from the sensor beyond which no cell is marked free, m"
    )
    accumulate: bool = Field(True, description="keep the map between sweeps; false: the latest sweep only")

    def settings(self, robot_height: float, start: tuple[float, float]) -> MapSettings:
        """Settings of the pure modules, as `IpabdParams.settings` returns them; `robot_height` is ignored."""
        filters = Filters(
            floor_tolerance=self.floor_tolerance,
            z_limit=inf if self.z_limit is None else self.z_limit,
            min_range=self.min_range,
            max_range_tolerance=self.max_range_tolerance,
        )
        return MapSettings(
            filters=filters,
            resolution=self.cell,
            anchor=self.anchor or start,
            extent=self.extent,
            free_range=self.free_range,
            bin_width=None if self.bin_width_deg is None else radians(self.bin_width_deg),
        )
