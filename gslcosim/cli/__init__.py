"""The command line: one small module a command, argument parsing and calls, no logic."""
