"""Where air meets what it cannot pass, and where it comes in and goes out: domain, patches, ghosts, edges, friction."""
