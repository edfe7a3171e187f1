"""Names for shell completion and for messages on unknown names, read without slow imports."""

import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pulsepath import registries

if TYPE_CHECKING:
    import click
    from click.shell_completion import CompletionItem

Completer = Callable[["click.Context", "click.Parameter", str], list["CompletionItem"]]


def list_presets(folder: str) -> list[str]:
    """Return the names of the presets in a folder of a package, as "kinematics/presets"."""
    home = Path(__file__).parents[1] / folder
    return sorted(file.stem for file in home.glob("*.toml"))


def list_names(table: str) -> list[str]:
    """Return the names in a table of `registries.TABLES`, and the names that a program added."""
    return [*registries.NAMES[table], *find_added(table)]


def find_added(table: str) -> list[str]:
    """Return the names in a table that `registries` does not list.

    A program can only have added some if the module of the table is loaded.
    """
    module, _, attribute = registries.TABLES[table].partition(":")
    keys: Iterable[str | tuple[str, ...]] = getattr(sys.modules.get(module), attribute, ())
    words = [word for key in keys for word in ((key,) if isinstance(key, str) else key)]
    return [word for word in words if word not in registries.NAMES[table]]


machines = partial(list_presets, "kinematics/presets")
programs = partial(list_presets, "planner/presets")
rigs = partial(list_presets, "controllers/presets")
measurements = partial(list_presets, "kinematics/calibration/presets")
kinds = partial(list_names, "kinds")
laws = partial(list_names, "laws")
rules = partial(list_names, "rules")
exports = partial(list_names, "exports")
imports = partial(list_names, "imports")


def stop_formats() -> list[str]:
    """Return the names of the export formats that can hold a stop."""
    return [name for name in exports() if name not in registries.FROM_REST.split()]


def make_completer(*sources: Callable[[], Iterable[str]], files: bool = False) -> Completer:
    """Return a function that completes names of `sources`, and with `files` those of files."""

    def complete(
        context: "click.Context", parameter: "click.Parameter", begun: str
    ) -> list["CompletionItem"]:
        from click.shell_completion import CompletionItem

        names = [name for source in sources for name in source()]
        fitting = [CompletionItem(name) for name in names if name.startswith(begun)]
        # The file comes first: bash drops the names that precede it.
        return [CompletionItem(begun, type="file"), *fitting] if files else fitting

    return complete
