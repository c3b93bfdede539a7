"""Evaluations on a Ray cluster: actors, each with the method and the data loaded, evaluate shards, which are merged.

Ray is imported only by an evaluation that asks for it. Shards travel as files of their stores, so that only the data has to be readable
from every node. What one worker loses (a killed process, a lost node) is evaluated again by another; the driver keeps finished shards
in the folder ``shards`` of the store until all of them are merged.
"""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from ._arrays import invalid
from .errors import AtsplatError
from .evaluation import RayOptions, Run
from .protocols import Data
from .stores import merge

#: Files of a store that belong to the process that writes it.
LOCKS = ("run.lock", "run.json")

DEFAULTS = RayOptions(retries=3, num_cpus=1, num_gpus=0, factory=False)


def evaluate(
    run: Run, method: Callable[..., Any] | str, given: bool | RayOptions, out: str, progress: Callable[[], None] | None
) -> tuple[str | None, list[Data]]:
    """Evaluates a run on a cluster: the one that Ray is connected to, or the one that ``ray.init()`` finds or starts. Returns why
    nothing was evaluated, if so, and the data."""
    options = _checked(given)
    if run.settings["shard"] is not None:
        raise invalid("shard", "Ray divides the run itself")
    if run.settings["keep_images"] != "none":
        raise invalid("keep_images", "expected none: images stay on the nodes")
    if isinstance(run.data, Data):
        raise invalid("data", "expected a path, which each worker opens")
    folder = Path(out, "shards")
    if Path(out, "provenance.json").exists() or (folder.exists() and not run.settings["resume"]):
        raise invalid("out", f"expected a folder without results, or with resume=True an unfinished run with Ray, found results in {out}")
    try:
        import ray
    except ImportError:
        raise invalid("ray", "expected the package ray, which is not installed: pip install ray") from None
    opened = run.open()
    scenes = max(len(data.entries) for data in opened)
    scenes = max(1, scenes if run.settings["limit"] is None else min(scenes, run.settings["limit"]))
    count = min(options.get("shards", max(64, scenes // 16)), scenes)
    shards = {number: folder / f"{number}-of-{count}" for number in range(1, count + 1)}
    is_connected = ray.is_initialized()
    if not is_connected:
        ray.init(logging_level=logging.WARNING)
    workers = _Workers(ray, {**DEFAULTS, **options})
    try:
        nothing = workers.evaluate(run, method, shards, progress)
    finally:
        workers.end()
        if not is_connected:
            ray.shutdown()
    merge(list(shards.values()), out)
    shutil.rmtree(folder)
    return None if None in nothing else nothing[0], opened


def _checked(given: Any) -> RayOptions:
    known = ", ".join(RayOptions.__annotations__)
    if given is True:
        return RayOptions()
    if not isinstance(given, dict):
        raise invalid("ray", f"expected True, False or a dict of {known}, found {given!r}")
    unknown = sorted(map(str, set(given) - set(RayOptions.__annotations__)))
    if unknown:
        raise invalid("ray", f"expected {known}, found {', '.join(unknown)}")
    for name, least in (("workers", 1), ("shards", 1), ("retries", 0), ("num_cpus", 0), ("num_gpus", 0)):
        number = given.get(name, least)
        kinds = (int, float) if name.startswith("num_") else (int,)
        if isinstance(number, bool) or not isinstance(number, kinds) or not least <= number < float("inf"):
            raise invalid("ray", f"{name}: expected {'a number' if float in kinds else 'an integer'} from {least}, found {number!r}")
    return cast(RayOptions, given)


class _Workers:
    """Actors, of which each evaluates one shard at a time."""

    def __init__(self, ray: Any, options: RayOptions) -> None:
        self._ray, self._options = ray, options
        self._actors: list[Any] = []
        self._idle: list[Any] = []
        #: Answers that are awaited, each with its actor and shard; an actor that loads has none.
        self._awaited: dict[Any, tuple[Any, int | None]] = {}

    def evaluate(
        self, run: Run, method: Callable[..., Any] | str, shards: dict[int, Path], progress: Callable[[], None] | None
    ) -> list[str | None]:
        """Evaluates shards into stores. Returns of each why nothing was evaluated, if so."""
        threads = max(1, int(self._options["num_cpus"]))
        self._loaded = self._ray.put((run, method, self._options["factory"], threads, os.getcwd()))
        queue, lost, left = deque(shards), Counter[Any](), set(shards)
        nothing: dict[int, str | None] = {}
        for _ in range(min(self._options.get("workers", self._fitting()), len(queue))):
            self._start()
        while left:
            (answer,), _ = self._ray.wait(list(self._awaited), num_returns=1)
            actor, number = self._awaited.pop(answer)
            try:
                result = self._ray.get(answer)
            except self._ray.exceptions.RayTaskError as error:
                raise error.cause from None
            except self._ray.exceptions.RayError as error:
                # The process or its node died.
                lost[number] += 1
                if lost[number] > self._options["retries"]:
                    what = "while it loaded" if number is None else f"with shard {number} of {len(shards)}"
                    raise AtsplatError(f"a worker died {what}, {lost[number]} times: {error}") from error
                self._discard(actor)
                if number is not None:
                    queue.appendleft(number)
                if not self._idle:
                    self._start()
            else:
                self._idle.append(actor)
                if number is None:
                    lost[None] = 0
                else:
                    files, steps, nothing[number] = result
                    _write(files, shards[number])
                    left.remove(number)
                    if progress is not None:
                        for _ in range(steps):
                            progress()
            while queue and self._idle:
                actor, number = self._idle.pop(), queue.popleft()
                self._awaited[actor.evaluate.remote(number, len(shards), _read(shards[number]))] = actor, number
        return [nothing[number] for number in shards]

    def end(self) -> None:
        for actor in list(self._actors):
            self._discard(actor)

    def _fitting(self) -> int:
        """Actors for which the cluster has resources at once."""
        there, wanted = self._ray.cluster_resources(), {"CPU": self._options["num_cpus"], "GPU": self._options["num_gpus"]}
        return max(1, min((int(there.get(kind, 0) // number) for kind, number in wanted.items() if number), default=1))

    def _start(self) -> None:
        resources = {kind: self._options[kind] for kind in ("num_cpus", "num_gpus")}
        actor = self._ray.remote(Worker).options(**resources).remote()
        self._actors.append(actor)
        self._awaited[actor.load.remote(self._loaded)] = actor, None

    def _discard(self, actor: Any) -> None:
        self._actors.remove(actor)
        self._ray.kill(actor)


class Worker:
    """An actor: what it loads stays from shard to shard."""

    def load(self, loaded: tuple[Run, Callable[..., Any] | str, bool, int, str]) -> None:
        self._run, method, is_factory, threads, folder = loaded
        os.environ.setdefault("RAYON_NUM_THREADS", str(threads))
        if os.path.isdir(folder):
            # Relative paths are the driver's.
            os.chdir(folder)
        self._method = method() if is_factory and not isinstance(method, str) else method
        if is_factory and not callable(self._method):
            raise invalid("method", f"expected a factory that returns a callable, found {type(self._method).__name__}")
        self._data = self._run.open()

    def evaluate(self, number: int, of: int, files: dict[str, bytes]) -> tuple[dict[str, bytes], int, str | None]:
        """Evaluates a shard, or verifies one that is finished: the files of its store, the number of results, and why there are none."""
        steps = 0

        def step() -> None:
            nonlocal steps
            steps += 1

        with tempfile.TemporaryDirectory(prefix="atsplat-") as folder:
            _write(files, Path(folder, "store"))
            nothing = self._run.evaluate(self._method, self._data, step, out=f"{folder}/store", shard=(number, of))
            return _read(Path(folder, "store")), steps, nothing


def _read(store: Path) -> dict[str, bytes]:
    """The files of a store whose run has ended; none if there is no store."""
    files = sorted(store.iterdir()) if store.is_dir() else []
    return {file.name: file.read_bytes() for file in files if file.is_file() and file.name not in LOCKS}


def _write(files: dict[str, bytes], store: Path) -> None:
    """Writes a store completely or not at all."""
    store.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix="partial-", dir=store.parent))
    for name, content in files.items():
        (partial / name).write_bytes(content)
    shutil.rmtree(store, ignore_errors=True)
    partial.rename(store)
