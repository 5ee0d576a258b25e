"""Shell completion and manual pages, both generated from the command tree."""
