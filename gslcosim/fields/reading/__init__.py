"""From filaments to mixing ratios: at points, on grids and along beams, by an index where many are read."""
