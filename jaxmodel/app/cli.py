"""The command line: what each command takes, and one sentence for every mistake.

The commands themselves are in `jaxmodel.app.commands` and are imported when one is called, so that help is shown at
once.
"""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Annotated

import typer

from jaxmodel.app.answers_command import compare_answers, history
from jaxmodel.app.diagnose_options import Add, Effects, With, Without
from jaxmodel.app.import_command import import_
from jaxmodel.app.one_sentence import TIMINGS, OneSentence
from jaxmodel.app.start_command import start
from jaxmodel.app.workbench_command import workbench
from jaxmodel.base.version import __version__

app = typer.Typer(
    cls=OneSentence,
    name="jaxmodel",
    help="Models of battery-powered DC drives: simulate, sweep, differentiate, and find what they miss.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
app.command(epilog="Example: jaxmodel start logs/*.csv --kind cell --ambient 23 --out results")(start)
app.command("import", epilog="Example: jaxmodel import logs/*.csv --kind cell --ambient 23 --out my_cell")(import_)

app.command(epilog="Example: jaxmodel workbench examples/samsung_30q")(workbench)


def _print_version(asked: bool) -> bool:
    if asked:
        print(f"jaxmodel {__version__}")
        raise typer.Exit()
    return asked


@app.callback()
def _of_all_commands(
    timings: Annotated[bool, typer.Option(TIMINGS, help="Say at the end where the time went.")] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


CasePath = Annotated[
    Path, typer.Argument(metavar="CASE", help="A folder with a case.toml, or the TOML file.", show_default=False)
]
CasePaths = Annotated[
    list[Path],
    typer.Argument(metavar="CASE...", help="Folders with a case.toml each, or TOML files.", show_default=False),
]
StudyPath = Annotated[Path, typer.Argument(metavar="STUDY.toml", help="The study file.", show_default=False)]
Out = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; made if need be.")]
OutOrUrl = Annotated[str, typer.Option("--out", metavar="DIR|URL", help="Folder, or a URL such as s3://bucket/name.")]
AnswerOnly = Annotated[bool, typer.Option("--answer-only", help="Write tables and answers, no pictures and no page.")]


@app.command(epilog="Example: jaxmodel simulate examples/samsung_30q --out results")
def simulate(
    case: CasePath,
    out: Out = Path("results"),
    fidelity: Annotated[
        str, typer.Option(metavar="formula|lut", help="The paper's formulas, or its look-up tables.")
    ] = "formula",
    effect: Effects = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Run the model of a case over every run: a CSV and a picture for each."""
    from jaxmodel.app.commands.simulate import simulate

    simulate(case, out, fidelity, effect or [], answer_only=answer_only)


@app.command(epilog="Example: jaxmodel sweep examples/paper_sweep.toml --out results")
def sweep(
    study: StudyPath,
    out: OutOrUrl = "results",
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a sweep that was stopped.")] = False,
    memory: Annotated[
        str | None,
        typer.Option("--memory", metavar="SIZE", help='For the chunks under way, as "512 MiB".', show_default=False),
    ] = None,
    engine: Annotated[
        str,
        typer.Option(
            metavar="local|xla|dask|tcp://HOST:PORT",
            help="This process, the same through XLA alone, a cluster of its own, or yours.",
        ),
    ] = "local",
    precision: Annotated[
        str | None,
        typer.Option(
            metavar="float64|float32", help="Instead of the study's: float32 screens many lanes.", show_default=False
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say lanes, chunks, memory, disk and time, and run none of it.")
    ] = False,
    effect: Effects = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Run every combination of a study's axes: tables, a Zarr store and pictures."""
    from jaxmodel.app.commands.sweep import sweep

    sweep(
        study,
        out,
        effect or [],
        resume=resume,
        memory=memory,
        engine=engine,
        precision=precision,
        dry_run=dry_run,
        pictures=not answer_only,
    )


@app.command(epilog="Example: jaxmodel sensitivity examples/paper_sweep.toml --at ambient_degC=20 --out results")
def sensitivity(
    study: StudyPath,
    out: Out = Path("results"),
    at: Annotated[
        list[str] | None,
        typer.Option(
            "--at",
            metavar="NAME=VALUE",
            help="A parameter or input of the point to look at, instead of the study's; may be given several times.",
            show_default=False,
        ),
    ] = None,
    gradient_only: Annotated[
        bool, typer.Option("--gradient-only", help="Leave out the doubling of each parameter.")
    ] = False,
    uncertain: Annotated[
        list[str] | None,
        typer.Option(
            "--uncertain",
            metavar="NAME=SD|case|DIR",
            help="Bands instead: a standard deviation, those that the study's case states, or results of identify.",
            show_default=False,
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            "--global", metavar="sobol|morris|dgsm", help="Indices over the study's ranges instead.", show_default=False
        ),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(min=2, help="Base points for --global (1024), runs to sample for --uncertain (512)."),
    ] = None,
    group: Annotated[
        list[str] | None,
        typer.Option("--group", metavar="NAME=A,B", help="What moves together, for --global.", show_default=False),
    ] = None,
    pair: Annotated[
        list[str] | None,
        typer.Option(
            "--pair", metavar="A,B", help="Second derivatives, and both doubled, instead.", show_default=False
        ),
    ] = None,
    over_axes: Annotated[
        bool, typer.Option("--map", help="Elasticities at every combination of the study's axes instead.")
    ] = False,
    no_pairs: Annotated[
        bool, typer.Option("--no-pairs", help="Leave out the second order of --global sobol: half the runs.")
    ] = False,
    effect: Effects = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Differentiate a study's run by its parameters, and double each beside it: tables, a Zarr store and pictures."""
    from jaxmodel.app.commands.sensitivity import global_indices, maps, sensitivity, uncertainty

    if (uncertain is not None) + (method is not None) + (pair is not None) + over_axes > 1:
        raise typer.BadParameter("give either --uncertain or --global or --pair or --map")
    if pair:
        from jaxmodel.app.commands.interactions import interactions

        interactions(study, out, at or [], effect or [], pair, pictures=not answer_only)
        return
    if over_axes:
        maps(study, out, at or [], effect or [], pictures=not answer_only)
        return
    if uncertain:
        uncertainty(study, out, at or [], effect or [], uncertain, count or 512, pictures=not answer_only)
        return
    if method:
        global_indices(
            study,
            out,
            at or [],
            effect or [],
            method=method,
            count=count or 1024,
            groups=group or [],
            second_order=not no_pairs,
            pictures=not answer_only,
        )
        return
    sensitivity(study, out, at or [], effect or [], doubling=not gradient_only, pictures=not answer_only)


@app.command(epilog="Example: jaxmodel identify examples/samsung_30q --parameter rc_capacitance_scale --out results")
def identify(
    case: CasePath,
    out: Out = Path("results"),
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            "--parameter",
            metavar="NAME",
            help="Ask for this parameter, also where the case states it as exact; may be given several times.",
            show_default=False,
        ),
    ] = None,
    profile: Annotated[
        list[str] | None,
        typer.Option(
            "--profile", metavar="NAME", help="Draw the likelihood along another unknown too.", show_default=False
        ),
    ] = None,
    add: Annotated[
        list[str] | None,
        typer.Option("--add", metavar="NAME", help="Add this effect, its parameters unknown.", show_default=False),
    ] = None,
    effect: Effects = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Show how well each parameter of a case can be determined, and by which run and sensor."""
    from jaxmodel.app.commands.identify import identify_case

    identify_case(case, out, parameter or [], profile or [], add or [], effect or [], answer_only=answer_only)


@app.command(epilog="Example: jaxmodel parameterise CASE --out parameterised")
def parameterise(
    case: CasePath,
    out: Out = Path("parameterised"),
    effect: Effects = None,
    answer_only: AnswerOnly = False,
    preset: Annotated[
        str | None, typer.Option(metavar="NAME", help="Write NAME.toml too, a preset.", show_default=False)
    ] = None,
    data: Annotated[str, typer.Option(help="For --preset: where the measurements are from.")] = "not stated",
    licence: Annotated[str, typer.Option(help="For --preset: of the measurements.")] = "none stated",
) -> None:
    """Extract first parameters with their sd from the fit runs of a case, and write the case that holds them."""
    from jaxmodel.app.commands.parameterise import parameterise_case

    parameterise_case(case, out, effect or [], answer_only=answer_only, preset=preset, data=data, licence=licence)


@app.command(epilog="Example: jaxmodel compare examples/samsung_30q --out results")
def compare(
    case: CasePath, out: Out = Path("results"), effect: Effects = None, answer_only: AnswerOnly = False
) -> None:
    """Calibrate the base model to a case and show where it fails, without trying any effect."""
    from jaxmodel.app.commands.diagnose import diagnose_all

    diagnose_all([case], out, effect or [], try_effects=False, answer_only=answer_only)


@app.command(epilog="Example: jaxmodel diagnose examples/samsung_30q --out results")
def diagnose(
    cases: CasePaths,
    out: Out = Path("results"),
    effect: Effects = None,
    add: Add = None,
    with_effects: With = None,
    without: Without = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Find which physics a model misses: answer.json, extended.toml, pictures and report.html for each case."""
    from jaxmodel.app.commands.diagnose import diagnose_all

    diagnose_all(
        cases,
        out,
        effect or [],
        answer_only=answer_only,
        add=add or [],
        with_effects=with_effects or [],
        without=without or [],
    )


app.command(epilog="Example: jaxmodel compare-answers results/before results/after")(compare_answers)
app.command(epilog="Example: jaxmodel history results/samsung_30q")(history)


@app.command(epilog="Example: jaxmodel demo --out demo-results")
def demo(
    out: Out = Path("demo-results"),
    case: Annotated[
        Path | None,
        typer.Option("--case", metavar="CASE", help="A case of your own instead of the real cell.", show_default=False),
    ] = None,
) -> None:
    """Do the whole job on real input in a few minutes: sweep, sensitivities, diagnosis, one page."""
    from jaxmodel.app.commands.demo import demo

    demo(out, case)


@app.command(epilog="Example: jaxmodel compensate --out results")
def compensate(
    out: Out = Path("results"),
    model: Annotated[
        list[Path] | None,
        typer.Option(
            "--model", metavar="CASE", help="A robot of yours beside the printed one; repeatable.", show_default=False
        ),
    ] = None,
    mission: Annotated[
        Path | None, typer.Option("--mission", metavar="MISSION.toml", help="For the gains.", show_default=False)
    ] = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Solve for the duty that holds the pace of the charge: maps as CSV and C headers, gains over a mission."""
    from jaxmodel.app.commands.compensate import compensate_models

    compensate_models(out, model or [], mission, pictures=not answer_only)


@app.command(epilog="Example: jaxmodel torque left right --out results")
def torque(
    cases: Annotated[
        list[Path], typer.Argument(metavar="CASE...", help="One for each motor, or of several.", show_default=False)
    ],
    out: Out = Path("results"),
    answer_only: AnswerOnly = False,
) -> None:
    """Find the torque that a load asked of each motor, from current and speed: by run, ground and side."""
    from jaxmodel.app.commands.torque import torque

    torque(cases, out, pictures=not answer_only)


@app.command(epilog="Example: jaxmodel estimate CASE --out results")
def estimate(
    case: CasePath,
    out: Out = Path("results"),
    count: Annotated[int, typer.Option("--tunings", min=2, help="Tunings to try on the fit runs.")] = 32,
    tuning: Annotated[
        Path | None,
        typer.Option("--tuning", metavar="tuning.json", help="Of an earlier run: tune nothing.", show_default=False),
    ] = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Estimate the state of charge by filters tuned on the fit runs of a cell and evaluated on its check runs."""
    from jaxmodel.app.commands.estimate import estimate

    estimate(case, out, count, tuning, pictures=not answer_only)


@app.command(epilog="Example: jaxmodel mission examples/missions/house_search.toml --out results")
def mission(
    plan: Annotated[
        Path | None, typer.Argument(metavar="MISSION.toml", help="The mission file.", show_default=False)
    ] = None,
    out: Out = Path("results"),
    model: Annotated[
        list[Path] | None,
        typer.Option("--model", metavar="CASE", help="A robot of yours; repeatable.", show_default=False),
    ] = None,
    age: Annotated[
        list[str] | None,
        typer.Option("--age", metavar="MONTHS,CYCLES", help="Of the pack; repeatable.", show_default=False),
    ] = None,
    answer_only: AnswerOnly = False,
) -> None:
    """Compute how long a robot can operate over temperature and age of its pack, and what ends the mission."""
    from jaxmodel.app.commands.mission import mission

    mission(plan, out, model or [], age or [], pictures=not answer_only)


@app.command(epilog="Example: jaxmodel fetch nissan_leaf")
def fetch(
    name: Annotated[
        str | None, typer.Argument(help="Of the set; without one, all are listed.", show_default=False)
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="For its files; by default called like it.", show_default=False)
    ] = None,
) -> None:
    """Fetch a public data set by its name, checked and kept in the cache, and show its licence."""
    from jaxmodel.app.commands.fetch import fetch_to, list_sets

    if name is None:
        list_sets()
    else:
        fetch_to(name, out)


@app.command(epilog="Example: jaxmodel export examples/samsung_30q --to c --out samsung_30q.c")
def export(
    case: CasePath,
    to: Annotated[
        str,
        typer.Option(
            metavar="FORMAT",
            help="actuator, bdf, c, c-filter, fmu, mujoco, pybamm, simscape, or one that a package adds.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The file; of bdf a folder.", show_default=False)],
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Of the format, as precision=float32 of c.", show_default=False),
    ] = None,
    effect: Effects = None,
) -> None:
    """Write the model of a case in the format of another tool, and say what the file does not carry."""
    from jaxmodel.app.commands.export import export_to

    export_to(case, to, out, effect or [], option or [])


def main() -> None:
    """Run the command line."""
    # What is imported and traced stays alive: to look through it again and again took 15 % of a diagnosis.
    gc.set_threshold(50_000)
    app()


if __name__ == "__main__":
    main()
