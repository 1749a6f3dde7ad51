"""Deadlines that tests need to end at all: generous, for how busy the machine is must decide nothing.

What is to be fast is printed by `make bench`; no test asserts it.
"""

EVENT_S = 60.0  # what is there at once on a machine with nothing else to do: a message, a file, the end of a process
PROCESS_S = 300.0  # a command from its start to its end
BUILD_S = 900.0  # a program built from sources, with packages that are fetched first
