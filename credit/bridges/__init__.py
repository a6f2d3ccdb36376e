"""Credit assignment for agents of other libraries: each file knows one of them, and is imported by its name."""
