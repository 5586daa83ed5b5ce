"""The manifest of a result: study, files, code and versions it was made from; and the difference of two manifests."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.resources
import inspect
import platform
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import jax

from jaxmodel.base.schema import with_schema
from jaxmodel.lanes import processor
from jaxmodel.sweeps.study import Study

# Whose versions can move a bit of a result, and whose cannot.
_DECIDING = ("jax", "jaxlib", "llvmlite", "equinox", "numpy", "scipy")
# The rooms whose code can move one.
_ROOMS = ("base", "lanes", "model", "effects", "case")
_VERSIONS_OF = ("jaxmodel", *_DECIDING, "xarray", "zarr")


def manifest_of(study: Study) -> dict[str, Any]:
    """Return what a result of a study is made from and by, ready for JSON."""
    return with_schema(
        {
            "title": study.title,
            "kind": study.prepared.model.kind,
            "study": study.model_dump(mode="json"),
            "study_sha256": study.digest,
            "files_sha256": study.file_digests,
            "variables": [*(metric.name for metric in study.prepared.metrics), *study.store, "status"],
            "code_sha256": code_digest(study),
            "versions": {"python": platform.python_version()}
            | {package: importlib.metadata.version(package) for package in _VERSIONS_OF},
            "machine": f"{jax.default_backend()}, {platform.machine()}, {processor()}",
        }
    )


def difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return what keeps a result begun under one manifest from going on under another, "" where nothing does."""
    was, now = old["study"], new["study"]
    changed = [key for key in now if was.get(key) != now[key]] + [key for key in was if key not in now]
    named = []
    for key in changed:
        tables = was.get(key), now.get(key)
        if all(isinstance(table, dict) for table in tables):
            inner = [name for name in tables[0] | tables[1] if tables[0].get(name) != tables[1].get(name)]
            named += [f"{key}.{name}" for name in inner]
        else:
            named.append(key)
    if named:
        return f"the study has changed ({', '.join(named)})"
    if list(was.get("axes", ())) != list(now.get("axes", ())):
        return "the study has changed (the order of its axes)"
    if ranges_of(was) != ranges_of(now):
        return "the study has changed (the order of its sample's ranges, to which the points are dealt)"
    for name, digest in new["files_sha256"].items():
        if old["files_sha256"].get(name) != digest:
            return f"the file {name} has changed"
    if old["code_sha256"] != new["code_sha256"]:
        versions = {manifest["versions"]["jaxmodel"] for manifest in (old, new)}
        return f"the code has changed (jaxmodel {' to '.join(sorted(versions))})"
    for package in _DECIDING:
        if old["versions"][package] != new["versions"][package]:
            return f"{package} is {new['versions'][package]}, and was {old['versions'][package]}"
    if old["machine"] != new["machine"]:
        return f"this machine is {new['machine']}, and it was {old['machine']}"
    return ""


def ranges_of(study: Mapping[str, Any]) -> list[str]:
    """Return what a study of a manifest draws for its lanes, in the order of its points."""
    return list((study.get("sample") or {}).get("ranges", ()))


def code_digest(study: Study) -> str:
    """Return the SHA-256 of all code that a lane's results come from: ours, and the user's own effects and metrics."""
    hashed = hashlib.sha256(sources_digest().encode())
    own = [type(part) for part in (*study.prepared.model.effects, *study.prepared.metrics)]
    for cls in own:
        if cls.__module__.partition(".")[0] not in ("jaxmodel", "sweeps"):
            hashed.update(_source_of(cls))
    for metric in study.prepared.metrics:
        hashed.update(re.sub(r" at 0x[0-9a-f]+", "", repr(metric)).encode())
    return hashed.hexdigest()


def _source_of(cls: type) -> bytes:
    try:
        return inspect.getsource(cls).encode()
    except (OSError, TypeError):  # typed in at a prompt: its name is all there is
        return cls.__qualname__.encode()


@lru_cache
def sources_digest() -> str:
    """Return the SHA-256 of the sources and presets of the packages that results come from."""
    hashed = hashlib.sha256()
    root = Path(str(importlib.resources.files("jaxmodel")))
    for folder in (*(root / room for room in _ROOMS), Path(__file__).parent):
        for path in sorted(file for ending in ("py", "toml") for file in folder.rglob(f"*.{ending}")):
            hashed.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return hashed.hexdigest()
