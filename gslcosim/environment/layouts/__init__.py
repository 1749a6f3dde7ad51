"""Layouts: environments from a few numbers, one module a family, and their furniture.

From outside: `kinds` turns any layout into a room of named boxes.
"""
