"""Rows of a recording, written tick by tick: one module for each kind of thing that is drawn."""
