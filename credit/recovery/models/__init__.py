"""Reward models: step → pseudo-reward, fitted to labels only."""
