"""Recordings read back as arrays."""
