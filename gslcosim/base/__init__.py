"""Ground that every package may import: errors, ticks, random streams, files, sockets, caches."""
