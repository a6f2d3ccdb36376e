"""Rules that turn a label into per-step rewards without a model of r(s, a)."""
