"""Films of runs: the plan with gas and track, the vehicle in its environment, time and readings."""
