"""Local viewer: a page on this computer that shows recordings, results and datasets, and only to who started it."""
