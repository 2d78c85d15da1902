"""The one place where external programs are run.

A program's output goes to a log file in its working folder. When it fails, the log is kept beside
the cache and the error names the program's own error line.
"""

import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalmanhdl.environment import cache_folder
from kalmanhdl.errors import ToolError

_ERROR_LINE = re.compile(
    r"\bERROR:|(^|\s)(fatal )?error:|undefined reference|^%?\w*Error(-\w+)?: ", re.MULTILINE
)
_POLL_SECONDS = 0.01
_LOGS_KEPT = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class Tool:
    """An external program: how it is called, and what to do where it is missing.

    Messages call it by ``title``, where it has another one than its name.
    """

    name: str
    command: tuple[str, ...]
    remedy: str
    title: str = ""

    def __str__(self) -> str:
        return self.title or self.name


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One call of a tool: its arguments and the folder it works in. Jobs run at once need a folder each."""

    tool: Tool
    arguments: tuple[str, ...]
    folder: Path

    @property
    def log(self) -> Path:
        """Where both of the tool's output streams go."""
        return self.folder / f"{self.tool.name}.log"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A call that succeeded: what the tool wrote, and how long it took."""

    output: str
    seconds: float


@contextmanager
def working_folder() -> Iterator[Path]:
    """A temporary folder that is gone afterwards, whatever happens."""
    with tempfile.TemporaryDirectory(prefix="kalmanhdl-", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@contextmanager
def in_background() -> Iterator[Callable[..., Future[Any]]]:
    """What starts work in a thread beside the block; where the block fails, the work's tools are killed."""
    pool = ThreadPoolExecutor(max_workers=1)
    try:
        yield pool.submit
    except BaseException:
        _broken_off.set()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        _broken_off.clear()


_broken_off = threading.Event()


def run(tool: Tool, arguments: Sequence[str], folder: Path) -> Run:
    """Run a tool to its end in a folder. Raises ToolError with the tool's own error line."""
    return run_all([Job(tool=tool, arguments=tuple(arguments), folder=folder)], parallel=1)[0]


def run_all(jobs: Sequence[Job], parallel: int) -> list[Run]:
    """Run jobs, up to ``parallel`` at once; results in the order of the jobs.

    The first failure, or Ctrl-C, kills all that still run, with their children.
    """
    waiting = list(reversed(list(enumerate(jobs))))
    running: dict[int, _Child] = {}
    done: dict[int, Run] = {}
    try:
        while waiting or running:
            while waiting and len(running) < max(1, parallel):
                index, job = waiting.pop()
                running[index] = _Child(job)
            for index, child in list(running.items()):
                if child.ended():
                    done[index] = child.result()
                    del running[index]
            if running:
                time.sleep(_POLL_SECONDS)
            if _broken_off.is_set():
                raise ToolError("broken off, because other work failed")
    finally:
        for child in running.values():
            child.kill()
    return [done[index] for index in range(len(jobs))]


class _Child:
    """A running process with a process group of its own."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._start = time.perf_counter()
        # Yosys and nextpnr leave a temporary folder behind when killed: let it be in the working folder.
        environment = {**os.environ, "TMPDIR": str(job.folder)}
        try:
            with job.log.open("wb") as log:
                self._process = subprocess.Popen(
                    [*job.tool.command, *job.arguments],
                    cwd=job.folder,
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
        except (FileNotFoundError, PermissionError) as error:
            raise ToolError(
                f"{job.tool}: cannot run {job.tool.command[0]!r} ({error.strerror}): {job.tool.remedy}"
            ) from error

    def ended(self) -> bool:
        return self._process.poll() is not None

    def result(self) -> Run:
        output = self._job.log.read_text(errors="replace")
        if self._process.returncode != 0:
            kept = _keep_log(self._job)
            raise ToolError(
                f"{self._job.tool} failed ({_exit_words(self._process.returncode)}): "
                f"{error_line(output)} (log: {kept})"
            )
        return Run(output=output, seconds=time.perf_counter() - self._start)

    def kill(self) -> None:
        with suppress(ProcessLookupError):
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
            else:
                self._process.kill()
        self._process.wait()


def error_line(output: str) -> str:
    """The first line in which a tool says what is wrong, else its last line."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    last = lines[-1] if lines else "it wrote nothing"
    return next((line for line in lines if _ERROR_LINE.search(line)), last)


def _exit_words(code: int) -> str:
    return f"exit code {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"


def _keep_log(job: Job) -> Path:
    folder = cache_folder("logs")
    name = f"{job.tool.name}-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}-{job.folder.name}.log"
    shutil.copyfile(job.log, folder / name)
    for old in sorted(folder.iterdir(), key=lambda path: path.name.split("-", 1)[1])[:-_LOGS_KEPT]:
        old.unlink(missing_ok=True)
    return folder / name
