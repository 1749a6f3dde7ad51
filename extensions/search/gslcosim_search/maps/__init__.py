"""Maps of gas and wind, and sources by how well their plume explains them."""
