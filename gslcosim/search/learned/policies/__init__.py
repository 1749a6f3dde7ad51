"""Learned policies: arrays in small files, and a forward pass in numpy alone."""
