"""Radio service: channels between agents; `core.RadioCore` is the participant."""
