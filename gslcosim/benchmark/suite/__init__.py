"""A suite: the file that says what is flown, turned into cases and trials; pure, nothing is flown here."""
