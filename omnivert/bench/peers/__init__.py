"""What a user could take instead of omnivert's vision, run on the same frames."""
