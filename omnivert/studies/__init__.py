"""Many synthetic drives, their theoretical limit, and what the calibration makes of them."""
