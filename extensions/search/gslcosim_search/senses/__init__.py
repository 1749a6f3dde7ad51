"""From readings to findings: hits, stops, wind on the way, what a camera sees."""
