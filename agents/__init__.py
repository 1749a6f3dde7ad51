"""Bundled agents: each folder is a program that sees only the contract."""
