"""Soft actor-critic for R replicas side by side."""
