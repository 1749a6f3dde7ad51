"""Gas that was computed or measured before: frames of other programs, films, and our own tapes."""
