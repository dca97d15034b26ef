"""Verify a dataset: whether it is what its plan says, and honest to learn from."""

from doppelgait.dataset.verify.contents import Check, Verification
from doppelgait.dataset.verify.run import verify_dataset

__all__ = ["Check", "Verification", "verify_dataset"]
