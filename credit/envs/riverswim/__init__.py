"""RiverSwim: a chain against the current, which never ends."""
