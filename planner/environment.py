"""What a process computes with: versions of Python and libraries, and the sources of packages, to be compared.

Two computers give the same results only where these agree.
"""

from collections.abc import Callable, Mapping, Sequence

Facts = dict[str, str]
"""Of a process: "python", a library, or "sources of PACKAGE" -> a version or a SHA-256."""
Look = Callable[[], Facts]

PACKAGES = ("kinematics", "planner")
LIBRARIES = ("pulsepath", "numpy", "scipy", "casadi", "numba", "osqp", "pin")
FIRST_FACTS: dict[tuple[str, ...], Facts] = {}
"""What was found when first looked for: sources that are changed later are not those that run."""


def make_fact_finder(packages: Sequence[str] = PACKAGES) -> Look:
    """A function that finds the facts of the process that calls it.

    It needs nothing of this project, and being local it is sent to another process as code, not by its name: so it
    finds them where another version of this project is installed, or none.
    """
    packages, libraries = tuple(packages), LIBRARIES

    def look() -> Facts:
        from hashlib import sha256
        from importlib.metadata import PackageNotFoundError, version
        from importlib.util import find_spec
        from pathlib import Path
        from platform import python_version

        try:
            from planner.environment import FIRST_FACTS as known
        except ImportError:  # none here, or one too old to have it
            known = {}
        key = (*packages, "", *libraries)
        if key in known:
            return known[key]
        facts = {"python": python_version()}
        for library in libraries:
            try:
                facts[library] = version(library)
            except PackageNotFoundError:
                facts[library] = "not installed"
        for package in packages:
            try:
                spec = find_spec(package)
            except ModuleNotFoundError:  # of the package that it is in
                spec = None
            digest = sha256()
            for root in (spec and spec.submodule_search_locations) or ():
                for name, file in sorted(
                    (file.relative_to(root).as_posix(), file) for file in Path(root).rglob("*.py")
                ):
                    digest.update(name.encode() + b"\0" + sha256(file.read_bytes()).digest())
            facts[f"sources of {package}"] = digest.hexdigest() if spec else "not installed"
        return known.setdefault(key, facts)

    return look


def describe_mismatches(ours: Mapping[str, str], theirs: Mapping[str, str]) -> list[str]:
    """What differs, in words; nothing where the same results can be expected."""
    found = []
    for what, here in ours.items():
        there = theirs.get(what, "not installed")
        if there != here:
            other = what.startswith("sources") and there != "not installed"
            found.append(f"other {what}" if other else f"{what} {there} (here {here[:12]})")
    return found
