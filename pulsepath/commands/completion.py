"""`pulsepath completion`: print the shell completion script."""

import click

SHELLS = ("bash", "zsh", "fish")
VARIABLE = "_PULSEPATH_COMPLETE"


@click.command(
    epilog="""\b
    Install it once for your shell:
      pulsepath completion bash > ~/.local/share/bash-completion/completions/pulsepath
      pulsepath completion zsh > "${fpath[1]}/_pulsepath"
      pulsepath completion fish > ~/.config/fish/completions/pulsepath.fish
    """
)
@click.argument("shell", type=click.Choice(SHELLS))
def completion(shell: str) -> None:
    """Print the completion script for SHELL.

    It completes commands, options, presets, formats, laws, firing rules and file names.
    """
    from click.shell_completion import get_completion_class

    complete = get_completion_class(shell)
    if complete is None:  # click has all three
        raise click.UsageError(f"no completion for {shell}")
    root = click.get_current_context().find_root().command
    click.echo(complete(root, {}, "pulsepath", VARIABLE).source())
