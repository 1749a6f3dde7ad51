"""Layouts: environments from a few numbers, one module for each group, and their furniture.

`builder` turns any layout into an environment of named boxes.
"""
