"""What is written into a recording tick by tick: one module for each kind of thing that is drawn."""
