"""Stored gas: frames of other programs, films of measured gas, and our own tapes."""
