"""Boundaries of the air: domain, patches, inflow, ghost faces, edges, and friction."""
