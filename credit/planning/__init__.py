"""Dynamic programming, and the transition models that it plans with."""
