"""The umbrella chain: one decision, and noise until its reward."""
