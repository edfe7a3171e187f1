"""Names for shell completion, and what lists say of them, without importing their modules: neither may wait.

Names are read from files. What only the modules can tell is kept on disk until a file of the project changes.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

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


def machine_kinds() -> list[str]:
    return registered_names("kinematics/machine/machine_file.py", "KINDS")


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


TABLES = {
    "laws": "controllers.laws.registry",
    "rules": "planner.pulses.generation.generate",
    "exports": "planner.export.format",
    "stops": "planner.export.format",
    "imports": "planner.sources.source",
}
"""Modules whose tables a program may add its own names to: once they are loaded, they tell, and not their files."""
CONTROLLERS = {
    "linuxcnc": "halstreamer", "ethercat": "csp", "klipper": "steps --named", "grbl": "g93", "grblhal": "g93",
    "fluidnc": "g93", "ros2": "ros", "newport": "xps", "csv": "pulses",
}  # fmt: skip
"""The export format, with its options, of controllers that people ask for by their own names."""
PACKAGES = ("kinematics", "planner", "controllers", "pulsepath")
"""What lists tell of, or tell it."""


def recall(what: str, make: Callable[[], Any]) -> Any:
    """What `make` returns, data for JSON, as it was made before; made again where a file has changed since.

    It is kept beside the source as compiled modules are or, where that may not be written, in the user's cache
    directory. A copy that is damaged, or cannot be kept, is made again.
    """
    if TABLES.get(what) in sys.modules:
        return json.loads(json.dumps(make()))
    state = _list_files()
    places = [Path(__file__).parent / "__pycache__", _user_cache()]
    for place in places:
        try:
            kept = json.loads((place / f"{what}.json").read_bytes())
            if kept["files"] == state:
                return kept["data"]
        except (OSError, ValueError, KeyError, TypeError):
            continue
    data = make()
    text = json.dumps({"files": state, "data": data}).encode()
    for place in places:
        try:
            place.mkdir(parents=True, exist_ok=True)
            written = place / f"{what}.{os.getpid()}.json"
            written.write_bytes(text)
            written.replace(place / f"{what}.json")
            break
        except OSError:
            continue
    return json.loads(text)["data"]


def _list_files() -> str:
    """A digest of Python's version, and of name, size and time of every file of the packages."""
    from hashlib import sha256

    found, pending = [sys.version], [str(_package_path(package)) for package in PACKAGES]
    while pending:
        with os.scandir(pending.pop()) as entries:
            for entry in entries:
                if entry.is_dir():
                    if entry.name != "__pycache__":
                        pending.append(entry.path)
                else:
                    stat = entry.stat()
                    found.append(f"{entry.path} {stat.st_size} {stat.st_mtime_ns}")
    return sha256("\n".join(sorted(found)).encode(errors="surrogateescape")).hexdigest()


def _user_cache() -> Path:
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "pulsepath"


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
