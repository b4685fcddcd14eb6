"""How fast it is, measured beside a yardstick in the same run: ratios travel from machine to machine, times do not."""
