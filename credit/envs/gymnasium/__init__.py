"""Any environment of Gymnasium, by its id: copies in lock-step, in this process or in others."""
