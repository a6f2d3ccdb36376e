"""Small networks side by side: one of each replica, in one batched product a layer."""
