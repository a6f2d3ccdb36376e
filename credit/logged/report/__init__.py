"""A recovery as one page that needs no network: for a reader who decides, and is no statistician."""
