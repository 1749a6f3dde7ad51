"""Trust in results of others: signed folders, and the public log of submissions."""
