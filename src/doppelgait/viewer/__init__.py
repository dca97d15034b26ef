"""Local viewer of recordings, results and datasets.

The page is served on this computer, and only to the user who started it.
"""
