"""The state of an object and of all that it holds, as plain values and arrays, and back into one built alike."""
