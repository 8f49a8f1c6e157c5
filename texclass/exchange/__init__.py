"""Textures and vibrations as files: our own, Penn HaTT XML, WAV. Nothing in a file is ever executed."""

from texclass.exchange.describe import describe
from texclass.exchange.families import family_class
from texclass.exchange.hatt_write import write_hatt
from texclass.exchange.hatt_xml import read_hatt
from texclass.exchange.texture_file import (
    TextureFile,
    load_taps,
    load_texture,
    read_texture_file,
    restore,
    save_texture,
)
from texclass.exchange.to_hatt import to_hatt
from texclass.exchange.wav import Vibration, read_wav, write_wav

__all__ = [
    "TextureFile",
    "Vibration",
    "describe",
    "family_class",
    "load_taps",
    "load_texture",
    "read_hatt",
    "read_texture_file",
    "read_wav",
    "restore",
    "save_texture",
    "to_hatt",
    "write_hatt",
    "write_wav",
]
