"""What stands in the way of a calibration: facts gathered once, then judged in the order in which the data flow."""
