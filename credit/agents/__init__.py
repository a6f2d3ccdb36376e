"""Policy optimizers that consume relabelled rewards."""
