"""Commands that calculate without a robot: from a recording, or from none."""
