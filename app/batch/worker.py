"""A worker process: draws a task for each line on its standard input, and answers with a line each."""

import json
import os
import sys
from pathlib import Path
from typing import Any

from app.batch.draw import TaskDrawer
from app.batch.jobs import Job, Task
from app.errors import AfterglowError


def task_from_json(spec: dict[str, Any]) -> Task:
    """The inverse of ``dataclasses.asdict``, after JSON."""
    job: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value
                           for key, value in spec["job"].items()}
    return Task(**{**spec, "job": Job(**job)})


def main() -> None:
    """Draw until the standard input ends; an error, whatever it is, is the answer of its task alone."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a library prints is no answer
    drawer = TaskDrawer()
    for line in sys.stdin:
        message, error = json.loads(line), ""
        try:
            drawer.draw(task_from_json(message["task"]), Path(message["out"]))
        except AfterglowError as problem:
            error = str(problem)
        except Exception as problem:  # of a library, for a scene that nobody has tried yet
            error = f"{type(problem).__name__}: {problem}"
        if error:
            drawer.close()
        print(json.dumps(" ".join(error.split())), file=answers, flush=True)


if __name__ == "__main__":
    main()
