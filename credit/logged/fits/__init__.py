"""Linear models of a step's credit fitted to labels of windows, and how they are mixed."""
