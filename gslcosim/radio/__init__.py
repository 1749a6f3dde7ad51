"""The channels on which agents talk: who hears what, and when."""
