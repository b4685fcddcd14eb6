"""Everything at once: start, smoother and what the drive has shown, over all keyframes of a stretch."""
