"""Gas that is not moved filament by filament: closed forms, and Farrell's open field."""
