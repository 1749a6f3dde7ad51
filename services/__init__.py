"""The process shell of every service: name a core, hand it to the runtime."""
