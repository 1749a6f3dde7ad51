"""Commands, legs and paths: how a search gets where it wants to be, and when it says that it is there."""
