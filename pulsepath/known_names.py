"""The names that shell completion offers, found without importing their modules: a keypress must not wait."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import click
    from click.shell_completion import CompletionItem

Completer = Callable[["click.Context", "click.Parameter", str], list["CompletionItem"]]


def preset_names(folder: str) -> list[str]:
    """Names of the presets in a package's folder, as "kinematics/presets"."""
    return sorted(file.stem for file in _package_path(folder).glob("*.toml"))


def registered_names(module: str, table: str) -> list[str]:
    """The names in the keys of a table that a module's source writes out, as "planner/export/format.py", FORMATS."""
    import ast

    for statement in ast.parse(_package_path(module).read_text(encoding="utf-8")).body:
        match statement:
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Dict() as value) if name == table:
                break
            case ast.AnnAssign(target=ast.Name(id=name), value=ast.Dict() as value) if name == table:
                break
    else:
        return []
    keys = [ast.literal_eval(key) for key in value.keys if key is not None]
    return [word for key in keys for word in ([key] if isinstance(key, str) else key)]


def machines() -> list[str]:
    return preset_names("kinematics/presets")


def programs() -> list[str]:
    return preset_names("planner/presets")


def rigs() -> list[str]:
    return preset_names("controllers/presets")


def measurements() -> list[str]:
    return preset_names("kinematics/calibration/presets")


def laws() -> list[str]:
    return registered_names("controllers/laws/registry.py", "LAWS")


def rules() -> list[str]:
    return registered_names("planner/pulses/generation/generate.py", "RULES")


def exports() -> list[str]:
    return registered_names("planner/export/format.py", "FORMATS")


def imports() -> list[str]:
    return registered_names("planner/sources/source.py", "SOURCES")


def make_completer(names: Callable[[], list[str]], *, files: bool = False) -> Completer:
    """Completes one of the names, or, where `files` may be given as well, a file: as soon as no name fits."""

    def complete(context: "click.Context", parameter: "click.Parameter", begun: str) -> list["CompletionItem"]:
        from click.shell_completion import CompletionItem

        fitting = [CompletionItem(name) for name in names() if name.startswith(begun)]
        # first: in bash what is a file's forgets what came before it
        return [CompletionItem(begun, type="file"), *fitting] if files else fitting

    return complete


def _package_path(path: str) -> Path:
    """A file or folder within a package of this project, which is not imported for it."""
    from importlib.util import find_spec

    package, _, rest = path.partition("/")
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        return Path(path)
    return Path(spec.submodule_search_locations[0]) / rest
