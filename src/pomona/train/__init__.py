"""Training of the shipped network; needs the `train` extra."""
