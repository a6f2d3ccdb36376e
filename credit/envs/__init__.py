"""Environments. `import credit` alone registers `credit/Advertiser-v0` and `credit/Sepsis-v0` with Gymnasium."""
