"""The recorder and its files: the only place that knows Rerun. Import its modules only where they are needed."""
