"""`omnivert explain CODE`: what a refusal means, why it is there, and the way out."""

import difflib
import textwrap
from typing import Annotated

import typer

from omnivert.cli import say
from omnivert.cli.explain.explanation import Explanation
from omnivert.cli.explain.explanations import EXPLANATIONS
from omnivert.cli.settings import JsonOption
from omnivert.errors import UseError


def explain(
    code: Annotated[str | None, typer.Argument(help="Such as OV104; all are listed without it.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Explain a refusal: what it means, why it is so, what to do."""
    if code is None:
        if as_json:
            say.json_result({key: _body(explanation) for key, explanation in _all()})
        for key, explanation in () if as_json else _all():
            say.result(f"{key}  {explanation.name.replace('_', ' ')}")
        return
    key = code.upper()
    if key not in EXPLANATIONS:
        near = difflib.get_close_matches(key, EXPLANATIONS, n=3, cutoff=0.6)
        hint = f"did you mean {' or '.join(near)}?" if near else "omnivert explain"
        raise UseError("OV207", f"there is no code {code}", help=hint)
    explanation = EXPLANATIONS[key]
    if as_json:
        say.json_result({"code": key, **_body(explanation)})
        return
    say.result(f"{key}  {explanation.name.replace('_', ' ')}")
    say.result("")
    for text in (explanation.meaning, explanation.cure):
        for line in textwrap.wrap(text, 94):
            say.result(f"  {line}")
        say.result("")


def _all() -> list[tuple[str, Explanation]]:
    return sorted(EXPLANATIONS.items())


def _body(explanation: Explanation) -> dict[str, str]:
    return {"name": explanation.name, "meaning": explanation.meaning, "cure": explanation.cure}
