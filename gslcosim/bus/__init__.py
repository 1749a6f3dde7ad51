"""How bytes travel between processes: one interface, in memory or over Zenoh."""
