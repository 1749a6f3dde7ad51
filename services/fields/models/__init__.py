"""Gas models of a scenario: filaments, Farrell's open field, Gaussian plumes, and playback of stored gas."""
