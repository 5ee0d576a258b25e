"""The behaviour tier: scenes in which plugins are measured against what they claim."""
