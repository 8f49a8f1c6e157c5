"""Recordings in: one module per file format, cards of datasets, folders of one's own."""

from texclass.loaders.cards import Card, CardError, read_card
from texclass.loaders.dataset import Dataset, Entry
from texclass.loaders.open import find_recording, open_dataset
from texclass.loaders.places import DataNotFoundError
from texclass.loaders.single import load_recording

__all__ = [
    "Card",
    "CardError",
    "DataNotFoundError",
    "Dataset",
    "Entry",
    "find_recording",
    "load_recording",
    "open_dataset",
    "read_card",
]
