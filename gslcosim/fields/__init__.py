"""Gas and wind as they truly are: the filament model, what it adds up to, and the core that samples it."""
