"""Studies of one method's parameters: sweeps with response curves, and tuning."""
