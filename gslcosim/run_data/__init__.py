"""What a run has left, as arrays; `gslcosim.open_run` is the way in."""
