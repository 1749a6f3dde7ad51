"""The events of a scenario: which of them begin when."""
