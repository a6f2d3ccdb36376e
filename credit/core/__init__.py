"""The records, the seams and the small tools that all rooms share."""
