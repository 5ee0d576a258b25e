"""Untrusted files: size bounds of each kind, and readers that keep them."""
