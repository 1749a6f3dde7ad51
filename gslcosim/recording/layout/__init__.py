"""How a recording is laid out in the viewer: panels, plots, and where the eye stands."""
