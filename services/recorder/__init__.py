"""Recorder service: writes the Rerun file of a run. Import its modules only where they are needed."""
