"""Transport of bytes between processes: one interface, in memory or over Zenoh."""
