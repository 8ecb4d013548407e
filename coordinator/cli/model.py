"""The commands `gepf model ...`: bodies drawn, listed and written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coordinator.commands.options.arguments import Force, Model

app = typer.Typer()


@app.callback(invoke_without_command=True)
def help_with_models(context: typer.Context) -> None:
    """Draw a body, name what moves it, or write it as URDF."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command()
def show(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.png", help="Picture to write.")],
    model: Model = "human",
    *,
    force: Force = False,
) -> None:
    """Draw a body at rest from three sides."""
    from coordinator.commands.model import draw_model

    draw_model(model, out, force=force)


@app.command()
def dofs(model: Model = "human") -> None:
    """List a body's degrees of freedom, for --dof and init.json."""
    from coordinator.commands.model import list_dofs

    list_dofs(model)


@app.command("export")
def export_model(
    out: Annotated[Path, typer.Option("--out", metavar="FILE.urdf", help="File to write, meshes beside it.")],
    model: Model = "human",
    *,
    force: Force = False,
) -> None:
    """Write a body as URDF, with a mesh for every link."""
    from coordinator.commands.model import write_as_urdf

    write_as_urdf(model, out, force=force)
