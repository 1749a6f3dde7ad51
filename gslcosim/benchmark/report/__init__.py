"""From the rows of a suite to a page, tables and pictures."""
