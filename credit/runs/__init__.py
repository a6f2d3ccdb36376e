"""One job: its folders, its checkpoints, its journal, its session."""
