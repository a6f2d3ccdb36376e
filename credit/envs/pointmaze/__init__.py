"""PointMaze (section 6.3): a ball that is pushed through a maze, one success bit for a whole trajectory."""
