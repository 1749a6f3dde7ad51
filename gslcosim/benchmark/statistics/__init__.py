"""Figures of many flights: pure functions of arrays, each with its interval where it has one."""
