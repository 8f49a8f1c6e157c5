"""Colours of the reproductions' pictures."""

INK, OURS, PAPER, FAINT = "#222222", "#1f5f99", "#c2571a", "#dddddd"
