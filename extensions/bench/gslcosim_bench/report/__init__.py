"""Report of a suite: from its rows to a page, tables and pictures."""
