"""Gas models of a scenario: filaments and Farrell's open field."""
