"""External participants: the user's own programs, in any language, behind a core that queries them at each step.

To the run each is a service: `core.ExternalCore` queries the program at each step with the gateway's frames; `protocol`
defines its ports and checks its frames.
"""
