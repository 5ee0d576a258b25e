"""Commands that write, replay, import and show recordings."""
