"""``ges effects``: what physics the simulator holds."""

from __future__ import annotations

import json

import click

from ges.simulator import effects


def _parameter_row(p: effects.Parameter) -> str:
    # NaN: the effect does not vanish by this parameter alone
    neutral = "" if p.neutral != p.neutral else f"{p.neutral:g}"
    return (
        f"| `{p.name}` | {p.unit} | {p.default:g} | {neutral} | {p.low:g} .. {p.high:g} | {p.doc} |"
    )


def _markdown(effect: effects.Effect) -> str:
    facts = [
        f"kind: {effect.kind}",
        f"channels: {', '.join(effect.channels)}",
        f"source: {effect.reference}",
    ]
    if effect.modifies:
        facts.append(f"acts on `{effect.modifies}` and is nothing without it")
    if effect.invariants:
        facts.append(f"promises: {', '.join(sorted(effect.invariants))}")
    head = (
        "| parameter | unit | typical | off | bounds | meaning |\n| --- | --- | --- | --- | --- |"
        " --- |"
    )
    rows = "\n".join(map(_parameter_row, effect.parameters))
    formula = "\n\n".join(f"$$ {line} $$" for line in effect.latex_lines)
    about = f"{effect.title}.\n\n{formula}\n\n{'; '.join(facts)}."
    return f"## {effect.name}\n\n{about}\n\n{head}\n{rows}\n"


def _page() -> str:
    intro = (
        "# Effects\n\nGenerated from the compiled library by `make docs`; the code is in"
        " `sim_c/effects/`.\n\nIn equations $T_i$ is the thrust, $\\Omega_i$ the speed and $r_i$"
        " the place of rotor $i$, $K_T$ the thrust coefficient, $V$ the velocity through the air,"
        " $\\omega$ the body rates.\n\n"
    )
    return intro + "\n".join(map(_markdown, effects.table().values()))


def _record(effect: effects.Effect) -> dict:
    return {
        "name": effect.name,
        "title": effect.title,
        "kind": effect.kind,
        "equation": effect.equation,
        "latex": effect.latex,
        "parameters": {
            p.name: {"unit": p.unit, "default": p.default, "low": p.low, "high": p.high}
            for p in effect.parameters
        },
    }


@click.command()
@click.argument("name", required=False)
@click.option("--markdown", is_flag=True, help="The whole table as a page for docs/.")
@click.option("--json", "as_json", is_flag=True, help="Names, equations and parameters as JSON.")
def command(name: str | None, markdown: bool, as_json: bool) -> None:
    """List the physical effects, or show one.

    Example: ges effects rotor_drag
    """
    if markdown:
        click.echo(_page(), nl=False)
    elif as_json:
        click.echo(json.dumps([_record(e) for e in effects.table().values()], indent=1))
    elif name:
        click.echo(_markdown(effects.get(name)), nl=False)
    else:
        for effect in effects.table().values():
            click.echo(f"{effect.name:30s} {effect.kind:9s} {effect.title}")
