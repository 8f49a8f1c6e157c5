"""Recognition in a stream: contact detection, windows, and verdicts for contacts."""
