"""Published ways to assign credit, a file each."""
