"""TorchRL's own losses as the policy optimizer of a run: PPO, TD3 and discrete SAC behind one adapter."""
