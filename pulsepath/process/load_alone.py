"""Load single modules of `kinematics.files` without the package, which takes a second to import."""

from functools import cache
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType


@cache
def load_alone(name: str) -> ModuleType:
    """Load a module that imports only the standard library."""
    home = find_spec("kinematics")
    assert home is not None  # it comes with this package
    assert home.origin is not None
    spec = spec_from_file_location(
        f"pulsepath.process.load_alone.{name}", Path(home.origin).with_name("files") / f"{name}.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
