"""Verification of a dataset: follows its plan, no leaks."""

from doppelgait.dataset.verify.contents import Check, Verification
from doppelgait.dataset.verify.run import verify_dataset

__all__ = ["Check", "Verification", "verify_dataset"]
