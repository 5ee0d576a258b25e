"""Pure geometry: angles, frames, rasters, footprints, collision, and worlds."""
