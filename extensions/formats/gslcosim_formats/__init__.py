"""Files of other programs: geometry, rooms, wind and gas that are read, and rooms that are written for others."""
