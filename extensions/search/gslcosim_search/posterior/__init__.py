"""Where the source is, as a probability, from all readings of a nose and the wind that brought their air."""
