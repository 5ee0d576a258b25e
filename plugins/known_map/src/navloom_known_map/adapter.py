"""A given map as a navloom mapper."""

from __future__ import annotations

import numpy as np
from navloom import Context, Mapper, MapperInput, MapUpdate, OccupancyGrid, Params

__all__ = ["KnownMap"]


class KnownMap(Mapper[Params]):
    """Publishes the map of its context once, and again after a clear request or a reset. It uses no sensor."""

    name = "known_map"
    accepts = ()
    needs_map = True

    def __init__(self, params: Params, context: Context) -> None:
        super().__init__(params, context)
        if context.map is None:
            raise ValueError('known_map: got no map, expected one; name it in [map], as in ref = "world"')
        self._map: OccupancyGrid = context.map
        self._is_published = False

    def reset(self) -> None:
        self._is_published = False

    def known(self) -> OccupancyGrid:
        return self._map

    def update(self, given: MapperInput) -> MapUpdate | None:
        if self._is_published and not given.clear:
            return None
        self._is_published = True
        return MapUpdate(given.stamp_ns, self._map, np.empty((0, 4)), ())
