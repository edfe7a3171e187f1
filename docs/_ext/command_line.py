"""The reference of the command line, made from the commands themselves: {command-line} module:group."""

import click
from docutils import nodes
from file_keys import named
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def markdown(command: click.Command, path: str) -> str:
    """A command's usage, help and options."""
    context = click.Context(command, info_name=path)
    usage = " ".join(command.collect_usage_pieces(context))
    said = (command.help or "").replace("\b", "")
    rows = [
        f"| `{' '.join(record[0].split())}` | {' '.join(record[1].split()).replace('|', chr(92) + '|')} |"
        for parameter in command.get_params(context)
        if (record := parameter.get_help_record(context)) is not None
    ]
    options = "\n".join(["| option | what it does |", "| --- | --- |", *rows])
    return f"```text\n{path} {usage}\n```\n\n{said}\n\n{options}\n"


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
