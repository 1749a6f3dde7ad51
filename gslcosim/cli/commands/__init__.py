"""One module per command: its arguments, its call and its output."""
