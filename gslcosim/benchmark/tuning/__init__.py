"""Parameters of one method: response curves over their values, and a search for good ones."""
