"""The framework's own decisions, as pure functions and small state machines: no I/O, no clock."""
