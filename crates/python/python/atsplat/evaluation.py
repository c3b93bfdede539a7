"""Evaluates any Python callable under protocols, into the same stores as ``atsplat run``."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import PurePath
from typing import Any, TypedDict

from . import _methods, _native, _warnings
from ._arguments import at_most, colour, folder_of_weights, path_of, shard_of
from ._arrays import invalid
from .errors import AtsplatError
from .protocols import Data, Protocol, check_setting, ids_of, protocol
from .stores import Store, open_store

Path = str | PathLike[str]


class RayOptions(TypedDict, total=False):
    """How an evaluation is spread over a Ray cluster."""

    #: Actors at once; by default as many as the cluster has processors (and GPUs, if asked for) for.
    workers: int
    #: Parts of the scenes; by default 64, or as many as give each 16 scenes.
    shards: int
    #: How often a shard is begun again after its worker died.
    retries: int
    #: Processors of each actor, which are its threads.
    num_cpus: float
    #: GPUs of each actor.
    num_gpus: float
    #: Whether the method is a function without arguments that loads the method, once on each actor.
    factory: bool


def evaluate(
    method: Callable[..., Any] | str,
    protocols: str | Path | Protocol | Sequence[str | Path | Protocol],
    *,
    data: Path | Data,
    out: Path,
    name: str | None = None,
    title: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    resume: bool = True,
    limit: int | None = None,
    shard: tuple[int, int] | None = None,
    metrics: Sequence[str] = (),
    weights: Path | None = None,
    keep_images: str = "none",
    setting: str = "ATSplat",
    deterministic: bool = False,
    version: str | int | None = None,
    antialiased: bool | None = None,
    constants: str | None = None,
    background: Sequence[float] | None = None,
    strict: bool = False,
    progress: Callable[[], None] | None = None,
    ray: bool | RayOptions = False,
    **options: Any,
) -> Store:
    """Evaluates a method on every trial of protocols.

    The method is called as ``method(context_images, context_cameras, target_cameras)``, on the calling thread, one trial at a time,
    while other threads read, score and store:

    - ``context_images``: V × H × W × 3, float32 in [0, 1];
    - ``context_cameras``, ``target_cameras``: :class:`~atsplat.Cameras` in the trial's normalised world.

    A method with a parameter named ``trial`` is also given an object with ``scene``, ``entry``, ``near_far`` (in the units of that
    world) and ``overlap``.

    It returns images (targets × H × W × 3, float in [0, 1] or uint8, of any library) or :class:`~atsplat.Gaussians` in the same world,
    which are rendered as the protocol says, or as ``antialiased``, ``constants`` and ``background`` say: with one of these, a trial of
    which it returns images fails. An exception, a wrong shape or NaN becomes a failed row with its reason, and the run goes
    on; :class:`~atsplat.NotApplicable` says that a method does not support a kind of trial. Ctrl-C stops the run; what was
    finished stays, and the next call resumes it.

    Args:
        method: any callable, or ``"nearest-view"`` or ``"warp"``, the baselines without learning.
        protocols: names, paths of ``.toml`` files, or :class:`~atsplat.Protocol`.
        data: the dataset, as for :meth:`atsplat.Protocol.open`.
        out: folder of the store, which is not that of the dataset.
        name: the method's name in the results; by default that of the function or class, of what wrappers wrap. A baseline has its own name, title,
            parameters and setting: others are an error.
        title: its title in tables and plots, one line of at most 80 characters.
        parameters: what determines its output, such as a checkpoint's hash: a store is only resumed with equal ones.
        resume: keep results that the store already has, if method, trial and data are unchanged, and try failed trials again; results
            without a metric that is requested now, or whose weights were not found then, are computed again. Otherwise the folder must
            not contain a store.
        limit: at most this many scenes, spread evenly over the index. Without a limit, or with a multiple of it, the next call adds
            the others.
        shard: ``(k, n)``: only the k-th of n parts of the scenes, from 1; :func:`atsplat.merge` merges them.
        metrics: in addition to the protocols' own, by id (:func:`atsplat.metrics`) in upper or lower case; ``all`` for every one.
        weights: folder of LPIPS weights, searched before torch's cache.
        keep_images: ``none``, ``worst`` (and typical and best) or ``all``.
        setting: whose published pose normalisation, near and far planes and renderer are used (:attr:`atsplat.Protocol.settings`).
        deterministic: whether equal input gives equal bits; drift then compares bit by bit.
        version: identifies the method instead of its code and values, which are hashed otherwise: functions and classes that are
            not installed, or are of the method's package; imported modules and compiled extensions that are not installed; versions
            of packages that are; constants, configurations, arrays, tensors and modules in closures, defaults, attributes,
            ``functools.partial`` and globals. Not hashed are files, and objects of other libraries, which are a warning: state them
            in ``parameters``.
        antialiased: render Gaussians in gsplat's ``antialiased`` mode, Mip-Splatting's 2D filter, or not; by default not, with a
            warning if they seem to be made for it.
        constants: a rasterizer whose constants Gaussians are rendered with, as for :func:`atsplat.render`, instead of the protocol's.
        background: RGB in [0, 1] behind Gaussians, instead of the protocol's.
        strict: raise if trials or targets failed, if entries of the index were skipped, if scenes or frames are missing, or if none of
            a trial's Gaussians is rendered; the store is complete apart from that.
        progress: called after each result; with ``ray``, for all of a shard when it has ended.
        ray: evaluate on a Ray cluster, with the options of :class:`~atsplat.RayOptions` if it is a dict. The method is pickled, and
            stays loaded in each worker; ``data`` is a path that every node can read. Functions of modules that nodes can import are not
            pickled: these modules must be the same on each node.
        options: ``index``, ``sampler``, ``any_size``, ``frames``, ``images``, ``prefer_undistorted``, as for
            :meth:`atsplat.Protocol.open`.

    Returns:
        The store. ``store.failures()`` lists rows that failed, ``store.skipped`` entries without a trial. What is not complete is a
        warning too, one for each kind, with a count and the first example.

    Raises:
        AtsplatError: if nothing could be evaluated, or the data or the store cannot be used; with ``strict``, also if something is
            missing.
        InvalidError: also if the folder contains results of another method with this name.
    """
    listed = [protocols] if isinstance(protocols, (str, PathLike, Protocol)) else list(protocols)
    if not listed:
        raise invalid("protocols", "expected at least one, found none")
    named = [one if isinstance(one, Protocol) else protocol(one) for one in listed]
    for one in named:
        check_setting(one, setting)
    rendering = (("antialiased", antialiased), ("constants", constants), ("background", background))
    for field, chosen in rendering if isinstance(method, str) else ():
        if chosen is not None:
            raise invalid(field, f"expected none for {method}, which gives no Gaussians, found {chosen!r}")
    record = _methods.record(method, name, title, {} if parameters is None else parameters, setting, deterministic, version)
    settings: dict[str, Any] = {
        "out": path_of(out, "out"),
        "resume": resume,
        "limit": at_most(limit),
        "shard": shard_of(shard),
        "metrics": ids_of(metrics),
        "weights": folder_of_weights(weights),
        "keep_images": keep_images,
        "setting": setting,
        "antialiased": antialiased,
        "constants": constants,
        "background": None if background is None else colour(background),
        "command": [PurePath(argument).name if at == 0 else argument for at, argument in enumerate(sys.argv)],
    }
    run = Run(named, data, options, record, settings)
    if ray is not False:
        from . import _ray

        nothing, opened = _ray.evaluate(run, method, ray, settings["out"], progress)
    else:
        opened = run.open()
        nothing = run.evaluate(method, opened, progress)
    store = open_store(out)
    warned = {row["kind"] for row in store.warnings}
    found = [
        f"{one.protocol.name}: {count} × {kind}: {one.examples[kind]}"
        for one in opened
        for kind, count in one.warnings.items()
        if kind not in warned
    ]
    for text in dict.fromkeys([*found, *_warnings.of_method(store, json.loads(record)["name"])]):
        warnings.warn(text, stacklevel=2)
    problem = None if nothing is None else f"nothing was evaluated: {nothing}"
    # A shard alone is complete; the other shards are missed where results are published.
    gaps = [gap["text"] for gap in store.gaps if not gap["missing_shards"]]
    if problem is None and strict and gaps:
        problem = "strict: expected a store without gaps, found " + "; ".join(gaps)
    if problem is not None:
        error = AtsplatError(problem)
        error.file = settings["out"]
        raise error
    return store


@dataclass(frozen=True)
class Run:
    """What is evaluated, apart from the method."""

    protocols: list[Protocol]
    data: Path | Data
    options: dict[str, Any]
    #: The method's record, as JSON.
    record: str
    settings: dict[str, Any]

    def open(self) -> list[Data]:
        opened = [one.open(self.data, **self.options) for one in self.protocols]
        for one in opened:
            one._native.check_out(self.settings["out"])
        return opened

    def evaluate(
        self, method: Callable[..., Any] | str, data: list[Data], progress: Callable[[], None] | None, **changes: Any
    ) -> str | None:
        """Evaluates into a store, with changed settings; returns why nothing was evaluated, if so."""
        called = method if isinstance(method, str) else _methods.adapted(method)
        return _native.evaluate(called, self.record, [one._native for one in data], {**self.settings, **changes}, progress)
