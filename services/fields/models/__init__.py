"""Gas models of a scenario: filaments, Farrell's open field and Gaussian plumes."""
