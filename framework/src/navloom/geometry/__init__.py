"""Pure geometry: angles, frames, rasters, footprints, collision and the worlds they are checked against."""
