"""Finite MDPs whose P and r are known: continuing ones and episodic ones."""
