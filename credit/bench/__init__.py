"""Speed and memory, measured against peers in one run, so that the ratios hold on any machine."""
