"""Readers of measured data: one module for each format, and the folders in which formats are recognised."""
