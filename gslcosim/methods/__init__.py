"""Method cards: needs, knowledge and settings of a search method, readable without running it."""
