"""Gas and wind outside of a run: samples at any points, and the truth for scoring. Never for agents."""
