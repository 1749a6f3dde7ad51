"""Build of a scenario's environment: geometry, wind and checks of the places in it."""
