"""The firing rules and their options in the help of a command, which loads them only when it is asked for help."""

import click


class WithRules(click.Command):
    """A command whose help ends with the firing rules."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write_paragraph()
        formatter.write("Rules:\n" + help_text() + "\n")


def help_text() -> str:
    """For each rule its name, the first line of its docstring, and its options with their defaults."""
    from planner.option import options
    from planner.pulses.rules import RULES

    width, lines = max(map(len, RULES)), []
    for name, rule in RULES.items():
        lines.append(f"  {name:<{width}}  {(rule.__doc__ or '').splitlines()[0]}")
        for field in options(rule).values():
            default = f"{field.default:g} {field.metadata['unit']}".rstrip()
            lines.append(f"  {'':<{width}}    {field.name}: {field.metadata['help']}; default {default}")
    return "\n".join(lines)
