"""Numbers of the descriptors by which a confined process talks with its supervisor."""

# Those that a shell can name by one digit, above its own.
PIPES_AT = (8, 9)
