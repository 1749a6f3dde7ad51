"""Recordings of runs: read back as arrays, shown in Rerun's viewer, cut and laid side by side."""
