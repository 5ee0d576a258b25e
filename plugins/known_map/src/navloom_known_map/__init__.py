"""A navloom mapper that publishes the map the framework hands in."""
