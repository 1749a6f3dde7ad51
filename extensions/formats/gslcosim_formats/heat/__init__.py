"""Heat of rooms: warm and cold bodies and surfaces that drive the wind of the built-in solver."""
