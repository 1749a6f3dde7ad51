"""Validity of runs: what speaks for or against their figures, and what agents did and sensed for it to be judged."""
