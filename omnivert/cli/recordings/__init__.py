"""Commands that make, play, take apart and translate recordings."""
