"""Building blocks of search methods, for any Python agent: pure functions and small states, seeded, without the truth.

Import from the modules: `draws` (random numbers), `instruments` (noses, vanes, ranges), `method` (settings of a method
card), `flying` (commands), `grids` and `beliefs` (probabilities over cells), and one module for each idea of the
literature. They know the contract's messages and nothing else of a run.
"""
