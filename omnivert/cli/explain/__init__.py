"""What refusals mean."""
