"""World service: vehicles with their autopilots, simulated in MuJoCo; `core.WorldCore` is the participant."""
