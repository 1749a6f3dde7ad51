"""Process shells: build a core, hand it to the runtime."""
