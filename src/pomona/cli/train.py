"""`pomona train`: a segmenter of your own."""

from __future__ import annotations


def train() -> None:
    """Fine-tune a segmenter (needs the extra `train`)."""
    raise NotImplementedError
