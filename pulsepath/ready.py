"""What the command `plan` has loaded in its second process before there is a plan."""

from importlib import import_module

ALWAYS, DRAWING = ("pulsepath.job",), ("benchmarks.report", "controllers.plots", "planner.plots")


def ready(figures: bool) -> None:
    """Import what `pulsepath.job` and, if they are asked for, the figures take."""
    for name in (*ALWAYS, *(DRAWING if figures else ())):
        import_module(name)
