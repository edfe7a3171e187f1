"""Facts of a process: versions of Python and libraries, and hashes of package sources.

Two computers give the same results only if these agree.
"""

from collections.abc import Callable, Mapping, Sequence

Facts = dict[str, str]
"""Facts of a process: "python", a library, or "sources of PACKAGE" -> a version or a SHA-256."""
Look = Callable[[], Facts]

PACKAGES = ("kinematics", "planner")
LIBRARIES = ("pulsepath", "numpy", "scipy", "casadi", "numba", "osqp", "pin")
FIRST_FACTS: dict[tuple[str, ...], Facts] = {}
"""Facts as they were at the first request: sources that change later are not those that run."""


def make_fact_finder(packages: Sequence[str] = PACKAGES) -> Look:
    """Return a function that finds the facts of the process that calls it.

    The function imports no module of this project. As it is local, it is sent to another process as
    code, not by name: so it also works if another version of this project is installed there, or
    none.
    """
    packages = tuple(packages)
    libraries = LIBRARIES

    def look() -> Facts:
        from hashlib import sha256
        from importlib.metadata import PackageNotFoundError, version
        from importlib.util import find_spec
        from pathlib import Path
        from platform import python_version

        try:
            from planner.environment import FIRST_FACTS as known
        except ImportError:  # not installed, or too old
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
            except ModuleNotFoundError:  # the parent package is missing
                spec = None
            digest = sha256()
            for root in (spec and spec.submodule_search_locations) or ():
                files = {
                    file.relative_to(root).as_posix(): file for file in Path(root).rglob("*.py")
                }
                for name in sorted(files):
                    digest.update(name.encode() + b"\0" + sha256(files[name].read_bytes()).digest())
            facts[f"sources of {package}"] = digest.hexdigest() if spec else "not installed"
        return known.setdefault(key, facts)

    return look


def describe_mismatches(ours: Mapping[str, str], theirs: Mapping[str, str]) -> list[str]:
    """Describe the facts that differ; an empty list if the same results can be expected."""
    mismatches = []
    for name, here in ours.items():
        there = theirs.get(name, "not installed")
        if there == here:
            continue
        if name.startswith("sources") and there != "not installed":
            mismatches.append(f"other {name}")
        else:
            mismatches.append(f"{name} {there} (here {here[:12]})")
    return mismatches
