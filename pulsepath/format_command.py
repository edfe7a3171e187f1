"""A command that takes its formats' options too; the formats load only when needed."""

from typing import ClassVar, Literal

import click


class FormatCommand(click.Command):
    """Such a command. `formats` names them in pulsepath.format_options."""

    formats: ClassVar[Literal["EXPORTS", "IMPORTS"]]

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        if ctx.resilient_parsing:  # while a shell completes, which must not wait for all formats to load
            return super().get_params(ctx)
        from pulsepath import format_options

        own = getattr(format_options, self.formats).options()
        return [*super().get_params(ctx)[:-1], *own, *super().get_params(ctx)[-1:]]  # --help stays last

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        from pulsepath import format_options

        formatter.write_paragraph()
        formatter.write("Formats:\n" + getattr(format_options, self.formats).help_text() + "\n")
