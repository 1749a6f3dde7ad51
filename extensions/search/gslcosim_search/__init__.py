"""Building blocks of search methods, for any Python agent: pure functions and small states, seeded, without the truth.

Import from the modules: `random_stream` (random numbers), `senses.instruments` (gas sensors, anemometers, range
finders), `grids` and `beliefs` (probabilities over cells), and one module for each idea of the literature. They know
the contract's messages and nothing else of a run. Commands and the settings of a method card are in
`gslcosim.agent_kit`.
"""
