"""Layouts: rooms of named boxes from a few numbers, by families, with their furniture."""
