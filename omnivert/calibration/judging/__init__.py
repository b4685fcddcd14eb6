"""What may be said: what is seen, what is claimed, what is missing and what to drive next."""
