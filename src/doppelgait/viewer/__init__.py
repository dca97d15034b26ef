"""Local viewer of recordings, results and datasets.

The page is served on this computer, only to the user who started it.
"""
