"""Any environment of Gymnasium, by its id, and what else has such a face: copies in lock-step, here or in workers."""
