"""Messages of sensors that are neither range scans nor sweeps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from navloom.messages import Message

__all__ = ["NO_READINGS", "Readings"]

Readings = Mapping[str, tuple[Message, ...]]
"""Messages of a step by the sensor's name, oldest first; a sensor with nothing new is left out."""


class _Nothing(Readings):
    """An empty mapping as the default of a field: a `dict` could be changed, and a proxy of one has no hash."""

    def __getitem__(self, name: str) -> tuple[Message, ...]:
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0

    __hash__ = object.__hash__


NO_READINGS: Readings = _Nothing()
"""Readings of a step without any new message."""
