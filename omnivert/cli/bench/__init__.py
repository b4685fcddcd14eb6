"""Commands that measure how fast and how good."""
