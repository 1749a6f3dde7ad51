"""Learned methods: observations as vectors, actions as commands, and policies in numpy alone."""
