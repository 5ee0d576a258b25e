"""The nodes of a robot: those around the roles, the framework's own, and the base of those of other distributions."""
