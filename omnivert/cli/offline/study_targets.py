"""The targets of a study beside the figures that it came to."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from omnivert.cli import say
from omnivert.cli.offline import results

if TYPE_CHECKING:
    from omnivert.studies.presets import Case

_ENOUGH_RUNS = 50  # a root mean square of so many is known to 10 %


def tell_targets(cases: "Sequence[Case]", each: dict[str, dict[str, Any]]) -> None:
    from omnivert.studies.summary import figure

    table: list[tuple[str, ...]] = [("target", "path", "figure", "wanted", "")]
    for case in cases:
        for name, (low, high) in case.targets.items():
            reached = {True: "✓", False: "✗ missed", None: "not known"}[each[case.name]["targets_met"][name]]
            wanted = f"{low:g}" if low == high else f"<= {high:g}" if low in (0.0, -math.inf) else f">= {low:g}"
            table.append((name.replace("_", " "), case.name, numbers(figure(each[case.name], name)), wanted, reached))
    if len(table) > 1:
        say.result("")
        for line in results.aligned(table):
            say.result(line)
        runs = min(each[case.name]["runs"] for case in cases)
        if runs < _ENOUGH_RUNS and any("efficiency" in row[0] for row in table):
            chance = f"chance alone moves error/bound by {100.0 / math.sqrt(2.0 * runs):.0f} %"
            say.note(f"of {runs} runs {chance}: the targets are for {_ENOUGH_RUNS} and more")


def numbers(value: Any) -> str:
    match value:
        case None:
            return "-"
        case list():
            return " ".join(numbers(part) for part in value)
        case int():
            return str(value)
        case _:
            return f"{value:.2f}"
