"""The loop of a worker: read a job, do it, say how it ended."""

from __future__ import annotations

import json
import os
import queue
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jaxmodel.app.browser.files import LOG, WANTED
from jaxmodel.app.browser.worker import answering, comparing, exploring, keeping, opening
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress, Stopped
from jaxmodel.app.one_sentence import sentence_of

JOBS: dict[str, Callable[..., None]] = {
    "open": comparing.open_case,
    "upload": comparing.open_upload,
    "import": opening.import_files,
    "compare": comparing.compare,
    "add": comparing.add,
    "drop": comparing.drop,
    "undo": comparing.undo,
    "diagnose": comparing.diagnose,
    "next": comparing.next_experiment,
    "changes": answering.changes,
    "forecast": exploring.forecast,
    "sweep": exploring.sweep,
    "sensitivity": exploring.sensitivity,
    "keep": keeping.keep,
}


def main() -> None:
    """Take the session's folder and then jobs from stdin, until it ends."""
    from jaxmodel.base.jax_settings import keep_compiled_programs

    os.umask(0o077)  # what a session holds is its owner's alone
    keep_compiled_programs()
    lines: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_listen, args=(lines,), daemon=True).start()
    folder = Path(json.loads(lines.get())["folder"])
    with (folder / LOG).open("ab") as log:
        os.dup2(log.fileno(), 2)
    place = Place(folder)
    while True:
        do(place, json.loads(lines.get()))


def _listen(lines: queue.Queue[str]) -> None:
    """Pass lines on; where the server has gone, leave at once: the job is begun again when it is back."""
    for line in sys.stdin:
        lines.put(line)
    os._exit(0)


def do(place: Place, job: dict[str, Any]) -> None:
    """Do one job, and leave in its file how it ended."""
    progress = Progress(place.folder, job, place.usual_s(job["do"]))
    try:
        if place.view.get("done") != job["id"]:  # else a server that was killed did not see it end, and asks again
            JOBS[job["do"]](place, progress, **job.get("with", {}))
    except Stopped:
        state, sentence = "stopped", ""
    except Exception as error:
        state, sentence = "failed", " ".join(sentence_of(error).split())
        if not sentence:  # a defect of ours: the log has it whole, the page names it
            traceback.print_exc()
            name = type(error).__name__
            sentence = f"The workbench failed here ({name}: {error}); worker.log in its folder has the rest."
    else:
        state, sentence = "done", ""
        place.took(job["do"], progress.elapsed_s)
    if state != "done":
        place.as_shown()
    (place.folder / WANTED).unlink(missing_ok=True)
    progress.end(state, sentence)


if __name__ == "__main__":
    main()
