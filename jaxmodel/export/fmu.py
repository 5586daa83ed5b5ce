"""A case's model as a functional mock-up unit (FMU) for co-simulation, by FMI 2.0 or 3.0: sources, and a binary."""

from __future__ import annotations

import html
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import jax

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.export.c_model import left_out_of_model
from jaxmodel.export.fmu_description import build_description, model_description
from jaxmodel.export.fmu_source import source_of
from jaxmodel.export.wording import identifier
from jaxmodel.lanes.emitter import NotNative

VERSIONS, BINARIES, COMPILERS = ("2", "3"), ("yes", "no"), ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2", "-shared", "-fvisibility=hidden")
# The oldest date of a zip file: the same case gives the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


def export_fmu(case: Case, *, fmi: str | int = "2", binary: str = "yes") -> Exported:
    """Return a case's model as an FMU for co-simulation.

    Args:
        case: of any kind, with at least one run, which says what the inputs are, the first ambient temperature, and
            the usual step.
        fmi: the version of the standard, 2 or 3.
        binary: "yes" for a binary of this platform beside the sources, where a C compiler is found; else "no".

    Raises:
        ParameterError: an option is unknown, or the model has an operation that has no C.
    """
    if str(fmi) not in VERSIONS:
        raise ParameterError(f"There is no FMU of FMI '{fmi}'; use {' or '.join(VERSIONS)}.")
    if binary not in BINARIES:
        raise ParameterError(f"The option 'binary' is {' or '.join(BINARIES)}, not '{binary}'.")
    version, name = int(fmi), identifier(case.name)
    model, profile = case_model(case), run_profile(case.runs[0])
    left_out = (
        *left_out_of_model(case, model, profile),
        "Tables and curves are constants of the FMU: numbers alone can be set.",
        "Inputs are held over a communication step; it has no derivatives of readings, and is not for model exchange.",
    )
    try:
        with jax.enable_x64(True):
            source = source_of(case, model, profile, left_out)
    except NotNative as error:
        raise ParameterError(f"{case.label}: its model cannot be written as C ({error}).") from error
    ours = resources.files("jaxmodel.export") / "fmi"
    sources = {each: (ours / each).read_bytes() for each in ("instance.h", f"fmi{version}.c")}
    sources["model.h"] = source.text.encode()
    files = {f"sources/{each}": content for each, content in sources.items()}
    if version == 3:
        files["sources/buildDescription.xml"] = build_description(case)
    if binary == "yes":
        place, ending = binary_place(version)
        compiled = _compiled(sources, f"fmi{version}.c", f"{name}.{ending}")
        if isinstance(compiled, str):
            left_out = (*left_out, compiled)
        else:
            files[f"binaries/{place}/{name}.{ending}"] = compiled
    else:
        left_out = (*left_out, "It has no binary: the program that imports it compiles the sources.")
    files["modelDescription.xml"] = model_description(case, source, profile, version, left_out)
    files["documentation/index.html"] = _page(case, left_out).encode()
    return Exported(_zipped(files), left_out)


def binary_place(version: int) -> tuple[str, str]:
    """Return the folder of binaries of this platform in an FMU of a version of FMI, and the ending of their names."""
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    ending = {"windows": "dll", "darwin": "dylib"}.get(system, "so")
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if version == 3:
        return f"{machine}-{system}", ending
    return f"{'win' if system == 'windows' else system}{64 if sys.maxsize > 2**32 else 32}", ending


def _compiled(sources: Mapping[str, bytes], main: str, library: str) -> bytes | str:
    """Return a shared library of the sources; or a sentence, where there is no compiler or it fails."""
    compiler = next((found for name in COMPILERS if (found := shutil.which(name)) is not None), None)
    if compiler is None:
        why = f"no C compiler ({', '.join(COMPILERS)}) was found"
        return f"It has no binary, as {why}: the program that imports it compiles the sources."
    position = () if sys.platform == "win32" else ("-fPIC",)
    with tempfile.TemporaryDirectory() as folder:
        for name, content in sources.items():
            Path(folder, name).write_bytes(content)
        command = [compiler, *FLAGS, *position, main, "-o", library, "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode != 0:
            why = next((line for line in done.stderr.splitlines() if "error" in line), "it says nothing")
            return f"It has no binary, as {compiler} failed ({why.strip()}): the sources are in it."
        return Path(folder, library).read_bytes()


def _page(case: Case, left_out: tuple[str, ...]) -> str:
    """Return the page that an FMU has for its user."""
    title = html.escape(case.title)
    items = "\n".join(f"<li>{html.escape(sentence)}</li>" for sentence in left_out)
    head = f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{title}</title></head>\n'
    said = f"<h1>{title}</h1>\n<p>A {case.kind} of jaxmodel. Current is positive on discharge.</p>\n"
    return f"{head}<body>\n{said}<p>What it does not carry:</p>\n<ul>\n{items}\n</ul>\n</body>\n</html>\n"


def _zipped(files: Mapping[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            archive.writestr(zipfile.ZipInfo(name, _DATE), files[name], zipfile.ZIP_DEFLATED)
    return content.getvalue()
