"""The messages between participants, their keys and their encoding: the centre everything else points to."""
