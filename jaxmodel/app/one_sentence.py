"""A group of commands that says a user's mistake in one sentence."""

from __future__ import annotations

import contextlib
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import typer
import typer.core

from jaxmodel.app.folders import let_go
from jaxmodel.app.timings import told

MISTAKE = 2
_STOPPED = 130
TIMINGS = "--timings"
_NO_MEMORY = "RESOURCE_EXHAUSTED"  # so JAX says it
_MOST_CHARACTERS = 800  # of a sentence, which may repeat a word of any length
_PARSED = (
    (r"Input should be a valid integer.*", "it must be a whole number."),
    (r"Input should be a valid number.*", "it must be a number."),
    (r"Input should be", "it must be"),
)


class OneSentence(typer.core.TyperGroup):
    """A group of commands that says a user's mistake in one sentence on stderr and leaves with exit code 2."""

    def main(self, *args: Any, standalone_mode: bool = True, **kwargs: Any) -> Any:
        """Run, as every click command does; without `standalone_mode` errors are raised instead."""
        if not standalone_mode:
            return super().main(*args, standalone_mode=False, **kwargs)
        sys.exit(self._exit_code(*args, **kwargs))

    def _exit_code(self, args: Sequence[str] | None = None, *others: Any, **kwargs: Any) -> int:
        words = list(sys.argv[1:] if args is None else args)
        given = [word for word in words if word != TIMINGS]  # before or after the command
        try:
            with _plain_remarks(), told() if TIMINGS in words else contextlib.nullcontext():
                code = super().main(given or ["--help"], *others, standalone_mode=False, **kwargs)
        except typer.TyperException as error:
            sentence = _plain(error.format_message())
            hint = "" if sentence.endswith("?") else "; --help shows what there is."
            return _mistake(sentence.rstrip("." if hint else "") + hint)
        except (typer.Abort, KeyboardInterrupt):
            _mistake("Stopped.")
            return _STOPPED
        except Exception as error:
            if sentence := sentence_of(error):
                return _mistake(sentence)
            raise
        finally:
            let_go()
        if code == _STOPPED:  # so typer says that Ctrl-C was pressed
            _mistake("Stopped.")
        return code if isinstance(code, int) else 0


def sentence_of(error: Exception) -> str:
    """Return what to say of an error that its user can do something about; "" for a defect of the program."""
    if isinstance(error, OSError):
        return f"{error.filename or 'file'}: {error.strerror or error}; give a file or folder that can be used."
    if isinstance(error, MemoryError) or (isinstance(error, RuntimeError) and str(error).startswith(_NO_MEMORY)):
        return (
            "There is too little memory for this; take fewer or shorter runs, or of a sweep less at once by --memory."
        )
    if isinstance(error, ValueError):
        from jaxmodel.base.errors import UserError

        return str(error) if isinstance(error, UserError) else ""
    return ""


def _plain(sentence: str) -> str:
    """Return what the parser of the words says of a wrong one in words for its user."""
    for parsed, said in _PARSED:
        sentence = re.sub(parsed, said, sentence)
    return sentence


@contextlib.contextmanager
def _plain_remarks() -> Iterator[None]:
    """Say a remark as a sentence on stderr, without the file and line of a warning."""

    def show(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        from jaxmodel.app.terminal import complain
        from jaxmodel.base.errors import RemarkWarning

        if issubclass(category, RemarkWarning):
            complain(str(message))
        else:
            shown(message, category, *place, **more)

    with warnings.catch_warnings():
        # By its words: importing its class would import the model before help is shown.
        warnings.filterwarnings("always", "The sweep runs through XLA")
        shown, warnings.showwarning = warnings.showwarning, show
        yield


def _mistake(sentence: str) -> int:
    from jaxmodel.app.terminal import complain

    if len(sentence) > _MOST_CHARACTERS:
        half = _MOST_CHARACTERS // 2
        sentence = f"{sentence[:half]} ... {sentence[-half:]}"
    complain(sentence)
    return MISTAKE
