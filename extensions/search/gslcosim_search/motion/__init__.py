"""Motion of a search: commands, legs and paths, and declarations of a source."""
