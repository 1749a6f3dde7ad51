"""Gas models of a scenario: filaments."""
