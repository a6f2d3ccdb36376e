"""Feature maps that know no environment."""
