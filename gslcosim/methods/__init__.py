"""Method cards: what a search method needs, knows and can be set to, readable without running it."""
