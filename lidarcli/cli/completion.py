"""`lidarcli completion`: what makes a shell complete commands, options and files."""

from __future__ import annotations

import click

from lidarcli.cli.grouped import GroupedCommand

SHELLS = ("bash", "zsh", "fish")
VARIABLE = "_LIDARCLI_COMPLETE"
"""By this variable the shell asks for completions."""


@click.command(
    cls=GroupedCommand,
    epilog="""Examples:

\b
  source <(lidarcli completion bash)
  echo 'source <(lidarcli completion bash)' >> ~/.bashrc
  lidarcli completion zsh > ~/.zfunc/_lidarcli
  lidarcli completion fish | source""",
)
@click.argument("shell", type=click.Choice(SHELLS), metavar="SHELL")
@click.pass_context
def completion(ctx: click.Context, shell: str) -> int:
    """Print the completion script for SHELL: bash, zsh or fish.

    docs/install.md says where each shell wants it.
    """
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None  # SHELLS are those that click knows
    click.echo(kind(ctx.find_root().command, {}, "lidarcli", VARIABLE).source())
    return 0
