"""The reference of the command line, made from the commands themselves: {command-line} module:group."""

from inspect import cleandoc

import click
from docutils import nodes
from file_keys import named
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def markdown(command: click.Command, path: str) -> str:
    """A command's usage, help, options, and what its help ends with."""
    context = click.Context(command, info_name=path)
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    rows = [f"| `{cell(name)}` | {cell(about)} |" for name, about in filter(None, records) if about]
    ending = context.make_formatter()
    command.format_epilog(context, ending)
    parts = [
        f"```text\n{path} {' '.join(command.collect_usage_pieces(context))}\n```",
        *(as_typed(part) for part in cleandoc(command.help or "").split("\n\n")),
        "\n".join(["| option | what it does |", "| --- | --- |", *rows]),
        f"```text\n{ending.getvalue().strip()}\n```" if ending.getvalue().strip() else "",
    ]
    return "\n\n".join(parts) + "\n"


EXAMPLE = "Example: "


def as_typed(paragraph: str) -> str:
    """Return a paragraph of help; lines that click leaves as they are, and an example, as code to be copied."""
    if paragraph.startswith("\b"):
        return f"```text{paragraph.removeprefix(chr(8))}\n```"
    if paragraph.startswith(EXAMPLE):
        return f"{EXAMPLE.strip()}\n\n```text\n{' '.join(paragraph.removeprefix(EXAMPLE).split())}\n```"
    return paragraph


def cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


class CommandLine(SphinxDirective):
    """A section for each command of a group."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        return list(self.sections(named(self.arguments[0]), "pulsepath"))

    def sections(self, group: click.Group, path: str) -> list[nodes.Node]:
        found: list[nodes.Node] = []
        for name, command in sorted(group.commands.items()):
            title = f"{path} {name}"
            section = nodes.section(ids=[nodes.make_id(title)], names=[title])
            section += nodes.title(text=title)
            section += self.parse_text_to_nodes(markdown(command, title))
            if isinstance(command, click.Group):
                section += self.sections(command, title)
            found.append(section)
        return found


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("command-line", CommandLine)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
