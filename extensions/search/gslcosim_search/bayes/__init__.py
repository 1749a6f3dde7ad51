"""Beliefs about the source: encounter models, grids, particles, hidden Markov chains, puffs traced back."""
