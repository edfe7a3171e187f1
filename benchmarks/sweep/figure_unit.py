"""The SI unit of a figure of recorded runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def unit_of(figure: str, task: str, record: Mapping[str, Any]) -> str:
    """SI unit of a figure on a path of recorded runs; empty for shares, and where axes of two kinds have it."""
    from controllers.metrics import FIGURES

    name, _, axis = figure.partition(".")
    unit = next((one.unit for one in FIGURES if one.name == name), "")
    kinds = {record["axes"].get(axis)} if axis else set(record["axes"].values())
    own = kinds.pop() if len(kinds) == 1 else ""
    return unit.replace("path", record["tasks"][task]["unit"]).replace("axis", own or "").removeprefix("1")
