"""Data that runs have left: read back as arrays, summarised, filtered, exported, drawn and filmed."""
