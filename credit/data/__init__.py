"""What is remembered of an agent's steps, in memory and in files."""
