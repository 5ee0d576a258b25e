"""The nodes of a robot: nodes around the roles, the framework's own nodes, and the base of node plugins."""
