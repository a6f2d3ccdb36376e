"""Tables of steps opened: files and frames, what their columns are, windows, and rows in parts."""
