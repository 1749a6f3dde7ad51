"""Rooms from a few numbers: one module a family of layouts, and what they are furnished with.

From outside: `kinds` turns any layout into a room of named boxes.
"""
