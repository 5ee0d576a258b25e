"""What the framework itself decides, as pure functions and small state machines: no I/O, no clock."""
