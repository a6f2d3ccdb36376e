"""What says how good a policy is."""
