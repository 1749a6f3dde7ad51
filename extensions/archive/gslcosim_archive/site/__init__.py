"""Static site of results: the report's page with a page for each method and each case, and a player of flights."""
