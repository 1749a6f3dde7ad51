"""Shared parts of learned methods: observations as vectors, actions as commands."""
