"""External participants: programs of the user's own, in any language, behind a core that asks them at each step.

Each is a service to the run: `core.ExternalCore` asks the program over the gateway's frames at each step; `protocol`
knows its ports and checks its frames.
"""
