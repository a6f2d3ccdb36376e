"""Soft actor-critic for R replicas side by side: networks, losses, replay, learner; no environment, no reward model."""
