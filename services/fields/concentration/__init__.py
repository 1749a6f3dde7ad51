"""Concentration: mixing ratios summed from filaments at points, on grids and along beams."""
