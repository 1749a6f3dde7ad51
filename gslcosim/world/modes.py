"""What a vehicle is steered by: a path, or what its agent sets."""

PATH = 0
ATTITUDE = 1
RATES = 2
DRIVE = 3
