"""External participants: programs of the user's own, in any language, behind a core that asks them at each step.

Each is a service to the run: `foreign_core.ForeignCore` is its core, which asks the program over the gateway's frames
at each step. `hearing` judges what the program says, `program` starts and ends it, `declared` knows its ports.
"""
