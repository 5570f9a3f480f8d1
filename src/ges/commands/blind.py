"""``ges blind``: conceal effects, diagnose blind, open the seal, score."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click

from ges.commands import PATH
from ges.commands.settings import SET

FOLDER = click.argument("folder", type=PATH, metavar="DIR")
PROCESSES = click.option(
    "--processes",
    type=click.IntRange(min=1),
    default=2,
    show_default=True,
    help="How many at a time.",
)
OF = click.option(
    "--of",
    "method",
    default="ges",
    show_default=True,
    help="ges, a baseline or an ablation (ges blind methods).",
)


MINUTES = click.option(
    "--minutes",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Begin nothing after so many minutes; the same command goes on later.",
)


class Progress:
    """A progress bar on stderr, shown at a terminal only.

    A call ``progress(done, total)`` moves it.

    Parameters
    ----------
    what : words before the bar.
    """

    def __init__(self, what: str):
        from rich.console import Console
        from rich.progress import Progress as Bars

        self.bars = Bars(console=Console(stderr=True), disable=not sys.stderr.isatty())
        self.task = self.bars.add_task(what, total=None)

    def __enter__(self) -> Progress:
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def __call__(self, done: int, total: int) -> None:
        self.bars.update(self.task, completed=done, total=total)


@click.group()
def command() -> None:
    """Make cases with concealed effects, diagnose them blind, open the seal and score.

    Example: ges blind make --seed 7 --out proof && ges blind run proof && ges blind score proof
    """


@command.command()
@click.option("--seed", type=click.IntRange(min=0), required=True, help="Seed of everything drawn.")
@click.option("--out", type=PATH, required=True, help="Folder for cases/ and sealed/.")
@click.option(
    "--grid",
    default="sample",
    show_default=True,
    help="Composition: smoke (4 cases), tiny (40), sample (60), third or full (1156).",
)
@PROCESSES
def make(seed: int, out: Path, grid: str, processes: int) -> None:
    """Write concealed cases and seal their truth.

    Example: ges blind make --seed 7 --grid tiny --out proof
    """
    from ges.blind.generator.make import make_cases

    start = time.perf_counter()
    with Progress("making") as progress:
        count = make_cases(out, seed, grid, processes, progress)
    click.echo(f"{count} cases sealed in {out}, {time.perf_counter() - start:.0f} s", err=True)


@command.command()
@FOLDER
@PROCESSES
@OF
@SET
@MINUTES
def run(
    folder: Path, processes: int, method: str, pairs: tuple[str, ...], minutes: float | None
) -> None:
    """Diagnose every case that has no verdict yet, each by a process that can read that case alone.

    Example: ges blind run proof --of stepwise --minutes 25
    """
    from ges.blind.protocol.run import method_folder, method_options, run_cases
    from ges.diagnose.settings import parse

    numbers = parse(pairs)
    start = time.perf_counter()
    with Progress("diagnosing") as progress:
        count, remaining = run_cases(
            folder,
            processes,
            out=method_folder(method, numbers),
            options=method_options(method, numbers),
            minutes=minutes,
            tell=progress,
        )
    rest = f"; {remaining} are left, the same command goes on" if remaining else ""
    click.echo(
        f"{count} cases diagnosed in {folder}, {time.perf_counter() - start:.0f} s{rest}", err=True
    )


@command.command()
@FOLDER
@click.option("--out", type=PATH, help="Folder for tables and figures; default: DIR/scores.")
@OF
@SET
def score(folder: Path, out: Path | None, method: str, pairs: tuple[str, ...]) -> None:
    """Open the seal and score the verdicts; writes CSV, JSON and figures.

    Sets of worlds are scored by world, beside the simple baselines that were run on them.

    Example: ges blind score proof
    """
    from ges.blind.protocol.run import method_folder
    from ges.blind.score.by_world import made_of_worlds, score_worlds
    from ges.blind.score.score import score_cases
    from ges.diagnose.settings import parse

    diagnosed = method_folder(method, parse(pairs))
    out = out or folder / diagnosed.replace("diagnosed", "scores", 1)
    # worlds differ in what any method could tell there, so each is scored by itself
    of_kind = score_worlds if made_of_worlds(folder) else score_cases
    report = of_kind(folder, out, diagnosed)
    for row in report["scores"]:
        if row["n"]:
            interval = f"[{row['low']:.3g}, {row['high']:.3g}]"
            name = f"{row['method']}: {row['score']}" if "method" in row else row["score"]
            click.echo(
                f"{name:<66} {row['value']:8.3g} {interval:<18} n={row['n']:<5}"
                f" {row['aim']:<8} {row['met']}"
            )


@command.command()
@click.argument(
    "folders",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    nargs=-1,
    required=True,
    metavar="DIR ...",
)
def calibrate(folders: tuple[Path, ...]) -> None:
    """Fit the correction of stated probabilities to diagnosed cases of development seeds.

    These are seeds below 1000. Prints two of ges settings. Example: ges blind calibrate dev-21
    dev-22
    """
    import numpy as np

    from ges.blind.score.platt import fit, pairs
    from ges.diagnose.select.probability import uncalibrated_log_odds

    stated = pairs(folders)
    # back to the search's own log odds: the correction in force would be fitted again
    offset, slope = fit(np.array([uncalibrated_log_odds(p) for p in stated[:, 0]]), stated[:, 1])
    click.echo(
        f"search.log_odds_offset={offset:.3g} search.log_odds_slope={slope:.3g}  #"
        f" {len(stated)} names, {stated[:, 1].mean():.1%} true"
    )


@command.command()
@click.argument("before", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("after", type=click.Path(path_type=Path, exists=True, file_okay=False))
def changes(before: Path, after: Path) -> None:
    """List what differs between two folders of verdicts on the same cases.

    Exits with 1 if anything does. New keys do not count.

    Example: cp -r proof/diagnosed proof/before, change the code, then ges blind run proof && ges
    blind changes proof/before proof/diagnosed
    """
    from ges.blind.score.changes import changed_cases

    changed = changed_cases(before, after)
    for case, differences in changed.items():
        click.echo(f"{case}: {len(differences)} differences, {differences[0]}")
    click.echo(f"{len(changed)} cases differ", err=True)
    if changed:
        sys.exit(1)


@command.command()
def methods() -> None:
    """List what can be run and scored on the same cases: ges, the baselines, the ablations.

    Example: ges blind methods
    """
    from ges.blind.protocol.run import METHODS

    for name in METHODS:
        click.echo(name)


@command.command()
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    required=True,
    help="Seed of everything drawn: below 1000 for development, from 1000 on for evaluation.",
)
@click.option(
    "--half",
    type=click.Choice(["development", "evaluation"]),
    required=True,
    help="Which half; the other one has other paths, rates and noise.",
)
@click.option("--out", type=PATH, required=True, help="Folder for cases/ and sealed/.")
@click.option("--only", multiple=True, metavar="NAME", help="A world; may be given several times.")
@click.option(
    "--every",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="Every so many-th set of each world.",
)
@click.option(
    "--recordings",
    type=PATH,
    envvar="GES_RECORDINGS",
    default=Path("recordings"),
    show_default=True,
    help="Published flights ('ges recordings fetch').",
)
@click.option(
    "--given",
    type=PATH,
    envvar="GES_WORLDS",
    default=Path("worlds"),
    show_default=True,
    help="Sets made elsewhere, a folder a world.",
)
@PROCESSES
@MINUTES
def worlds(
    seed: int,
    half: str,
    out: Path,
    only: tuple[str, ...],
    every: int,
    recordings: Path,
    given: Path,
    processes: int,
    minutes: float | None,
) -> None:
    """Write sets from worlds that the diagnosis was not tuned on.

    They are simulators of others (extra 'simulators'), real flights, and the home generator in
    other airs and by a second author.

    Example: ges blind worlds --seed 7 --half development --only rotorpy --out abroad
    """
    from ges.blind.foreign.sets import Sources
    from ges.blind.foreign.worlds import make_worlds

    start = time.perf_counter()
    with Progress("flying") as progress:
        count, total, skipped = make_worlds(
            out,
            half,
            seed,
            only,
            every,
            Sources(recordings, given),
            processes,
            minutes,
            progress,
        )
    for name, why in skipped.items():
        click.echo(f"{name} is left out: {why}", err=True)
    rest = "" if count == total else "; the same command goes on"
    click.echo(
        f"{count} of {total} sets in {out}, {time.perf_counter() - start:.0f} s{rest}", err=True
    )
