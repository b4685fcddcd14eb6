"""Frame by frame: the filter, its life between two seeds, and the watchdog on its innovations."""
