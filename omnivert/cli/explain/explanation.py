"""What is said of a refusal beyond its one line."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Explanation:
    """One refusal: its short name, what it means and why, and what to do."""

    name: str
    meaning: str
    cure: str
