"""Spoilt words of any command are refused in one sentence with exit code 2, or do what they say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stress.words import commands, said, trial

TRIALS = 4


@pytest.mark.slow("compare", "compensate", "estimate", "parameterise", "sensitivity", "start", "sweep")
@pytest.mark.parametrize("name", commands())
def test_spoilt_words_break_no_command(name: str, tmp_path: Path) -> None:
    ends = [trial(name, seed, tmp_path) for seed in range(TRIALS)]
    assert [(ended.words, ended.wrong) for ended in ends if ended.wrong] == []


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["start", "log.csv", "--capacity", "large"], "it must be a number"),
        (["start", "log.csv", "--ambient", "warm"], "--ambient: 'warm' is not a number; correct it."),
        (["sensitivity", "study.toml", "--count", "many"], "it must be a whole number"),
        (["simulate", "x" * 5000], " ... "),
    ],
)
def test_what_the_parser_of_the_words_says_is_plain_and_short(words: list[str], sentence: str, tmp_path: Path) -> None:
    ended = said(words, tmp_path)
    assert ended.code == 2
    assert ended.wrong == ""
    assert sentence in ended.sentence
