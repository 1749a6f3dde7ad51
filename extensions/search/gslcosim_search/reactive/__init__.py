"""Searches that react: walks, casts, surges, spirals, gradients, and what they share."""
