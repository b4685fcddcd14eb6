"""One thin process each: `python -m services.NAME --config FILE`."""
