"""Policy optimizers: they consume relabelled rewards, and never see a label's making."""
