"""How fast it is, measured beside a yardstick in the same run: ratios travel from machine to machine, times do not.

And how right it is, against a truth (`score`), beside what a user could take instead (`peers`).
"""
