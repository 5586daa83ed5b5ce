"""Compiled programs are kept in a folder of the user alone, and read from no other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

from jaxmodel.base import jax_settings
from jaxmodel.base.cache import keep, kept, why_not_private
from jaxmodel.base.errors import RemarkWarning


@pytest.fixture
def cache(tmp_path: Path) -> Iterator[Path]:
    before = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def test_what_is_kept_is_given_back_from_a_folder_of_the_owner_alone(cache: Path) -> None:
    assert kept("one.o") is None
    keep("one.o", b"machine code")
    assert kept("one.o") == b"machine code"
    (file,) = cache.rglob("one.o")
    assert file.parent.stat().st_mode & 0o777 == 0o700
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("damage", [lambda whole: whole[:-1], lambda whole: whole[:-1] + b"!", lambda whole: b""])
def test_what_is_cut_off_or_has_changed_is_not_read(cache: Path, damage) -> None:
    keep("one.o", b"machine code")
    (file,) = cache.rglob("one.o")
    file.write_bytes(damage(file.read_bytes()))
    assert kept("one.o") is None


def test_nothing_is_read_from_a_folder_to_which_others_may_write(cache: Path) -> None:
    keep("one.o", b"machine code")
    (cache / "programs").chmod(0o770)
    with pytest.warns(RemarkWarning, match=r"are not used, because other users may write to it; remove the folder"):
        assert kept("one.o") is None
    with pytest.warns(RemarkWarning):
        keep("two.o", b"more")
    assert not (cache / "programs" / "two.o").exists()


def test_nothing_is_read_from_a_folder_of_another_user(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep("one.o", b"machine code")
    monkeypatch.setattr(os, "getuid", lambda: (cache / "programs").stat().st_uid + 1)
    with pytest.warns(RemarkWarning, match="because it belongs to another user"):
        assert kept("one.o") is None


def test_a_folder_that_others_can_read_is_closed_to_them(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    assert why_not_private(tmp_path) == ""
    assert tmp_path.stat().st_mode & 0o777 == 0o700


def test_jax_reads_no_programs_from_a_folder_to_which_others_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o777)
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv("JAXMODEL_CACHE", str(tmp_path))
    before = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    assert "other users may write to it; the next run will compile again" in jax_settings.keep_compiled_programs()
    assert jax.config.jax_compilation_cache_dir == before  # type: ignore[attr-defined]


def test_a_full_disk_keeps_nothing_and_breaks_nothing(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: bytes) -> int:
        path.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    keep("one.o", b"machine code")
    assert list((cache / "programs").iterdir()) == []
