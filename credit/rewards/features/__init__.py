"""Feature maps: what a reward model looks at. A new surrogate is one class here (or anywhere) and one YAML file."""
