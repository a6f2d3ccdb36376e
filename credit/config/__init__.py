"""Compose, check and build: what YAML names, and Hydra."""
