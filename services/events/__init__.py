"""Events service: announces which of a scenario's events begin; `core.EventsCore` is the participant."""
