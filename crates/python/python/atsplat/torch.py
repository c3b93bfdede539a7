"""For PyTorch: trials as a dataset, and evaluation while a model trains. Importing this module imports PyTorch."""

from __future__ import annotations

import hashlib
import pickle
import warnings
from collections.abc import Callable, Sequence
from os import PathLike, fspath
from typing import Any

import torch
from torch.utils.data import Dataset

from ._arrays import invalid
from .cameras import Cameras
from .drift import Drift, drift
from .errors import DriftedError
from .evaluation import evaluate
from .metrics import metrics
from .protocols import Data, Protocol, Skipped, check_setting, protocol
from .stores import Store

Path = str | PathLike


class TrialDataset(Dataset):
    """The trials of a protocol as tensors, for data loaders with any number of workers.

    An item is a dict of ``scene`` and ``entry``, ``near_far`` (2), and for ``context`` and ``target`` each: ``context_images``
    (V × 3 × H × W, float32 in [0, 1]), ``context_world_from_camera`` (V × 4 × 4, float32, OpenCV axes) and ``context_intrinsics``
    (V × 3 × 3, float32, in units of the image's size); lens distortion is left out, with a warning. ``target_images`` are only there
    with ``supervise=True``, for training: a method under evaluation may not see them.

    Args:
        of: a protocol, by name or opened.
        data: the dataset's path.
        limit: at most this many scenes, spread evenly over the index.
        setting: whose published pose normalisation, near and far planes are used.
        supervise: whether items have the targets' images.
        options: as for :meth:`atsplat.Protocol.open`.
    """

    def __init__(
        self,
        of: str | Protocol,
        data: Path,
        *,
        limit: int | None = None,
        setting: str = "ATSplat",
        supervise: bool = False,
        **options: Any,
    ) -> None:
        name = of._source if isinstance(of, Protocol) else fspath(of)
        self._source, self._options = (name, fspath(data)), options
        self._setting, self._supervise = setting, supervise
        self._data: Data | None = None
        self._warned_of_lenses = False
        check_setting(self._opened().protocol, setting)
        # No image is decoded for that.
        trials = self._opened()._native.trials(setting, limit, None, False)
        self._entries: list[tuple[str, int]] = []
        #: Entries of the index that have no trial, and so no item, with the reason.
        self.skipped: list[Skipped] = []
        while (outcome := trials.next()) is not None:
            trial, skipped = outcome
            if trial is None:
                self.skipped.append(Skipped(*skipped))
            else:
                seen = trial.input()
                self._entries.append((seen.scene, seen.entry))
        if self.skipped:
            count, first = len(self.skipped), self.skipped[0]
            text = f"{count} of {count + len(self)} entries of the index have no trial, first {first.scene}: {first.detail}"
            warnings.warn(text, stacklevel=2)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_data": None}

    def _opened(self) -> Data:
        if self._data is None:
            name, path = self._source
            self._data = protocol(name).open(path, **self._options)
        return self._data

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, at: int) -> dict[str, Any]:
        scene, entry = self._entries[at]
        trials = self._opened()._native.trials(self._setting, None, (scene, entry), False)
        outcome = None
        while trials.left():
            outcome = trials.next()
        if outcome is None or outcome[0] is None:
            raise invalid("data", f"scene {scene!r}, entry {entry} has no trial any more")
        trial, seen = outcome[0], outcome[0].input()
        item: dict[str, Any] = {"scene": scene, "entry": entry, "near_far": torch.tensor(seen.near_far)}
        item["context_images"] = _channels_first(seen.context_images())
        if self._supervise:
            item["target_images"] = _channels_first(trial.target_images())
        distorted = 0
        for views, cameras in (("context", seen.context_cameras()), ("target", seen.target_cameras())):
            posed = Cameras._of(*cameras)
            distorted += sum(lens != "pinhole" for lens, _ in posed.lenses)
            item[f"{views}_world_from_camera"] = torch.from_numpy(posed.world_from_camera).float()
            item[f"{views}_intrinsics"] = torch.from_numpy(posed.intrinsics).float()
        if distorted and not self._warned_of_lenses:
            self._warned_of_lenses = True
            text = f"scene {scene!r}, entry {entry}: {distorted} views have lens distortion, which items leave out (only said once)"
            warnings.warn(text, stacklevel=2)
        return item


def _channels_first(images: Any) -> torch.Tensor:
    return torch.from_numpy(images).permute(0, 3, 1, 2).contiguous()


class Evaluation:
    """Evaluates a method every N steps of a training, and fails if it is worse than a baseline.

    >>> check = Evaluation("re10k-2v-256", "data/re10k", "runs/a", every=5000, limit=50, baseline="baseline.json")
    >>> for step, batch in enumerate(loader):
    ...     train(model, batch)
    ...     check(step, model)

    A module's state is a parameter of the method (``state-sha256``, see :func:`state_hash`): an interrupted evaluation is resumed with
    the same state, and the store of another training is an error, not the result. Other callables have no such state: for them, a
    folder that already holds results is an error, unless ``resume=True``.

    Args:
        protocols: as for :func:`atsplat.evaluate`.
        data: the dataset.
        out: folder for one store of each evaluated step, ``step-00005000``.
        every: number of steps between evaluations; step 0 is not evaluated.
        baseline: the file of :func:`atsplat.accept_baseline`; without it, nothing fails.
        fail: ``worse`` fails if a mean is worse than the baseline's beyond its limit, ``any`` on every drift.
        options: as for :func:`atsplat.evaluate`.
    """

    def __init__(
        self,
        protocols: str | Sequence[str],
        data: Path,
        out: Path,
        *,
        every: int,
        baseline: Path | None = None,
        fail: str = "worse",
        **options: Any,
    ) -> None:
        if every < 1:
            raise invalid("every", f"expected a number of steps from 1, found {every}")
        if fail not in ("worse", "any"):
            raise invalid("fail", f"expected worse or any, found {fail!r}")
        self._protocols, self._data, self._out = protocols, data, fspath(out)
        self._every, self._baseline, self._fail, self._options = every, baseline, fail, options
        #: The stores so far, by step.
        self.stores: dict[int, Store] = {}
        #: The last comparison with the baseline.
        self.drift: Drift | None = None

    def __call__(self, step: int, method: Callable) -> Store | None:
        """Evaluates ``method`` if it is time to; a module, or a method of one, runs in ``eval`` mode without
        gradients.

        Raises:
            DriftedError: if it is worse than the baseline.
        """
        if step == 0 or step % self._every:
            return None
        store = self.stores[step] = self._evaluate(step, method)
        if self._baseline is not None:
            self.drift = drift(store, self._baseline)
            if self.drift.verdict == "nothing" or (self._fail == "any" and self.drift.drifted) or worse(self.drift):
                raise DriftedError(self.drift)
        return store

    def _evaluate(self, step: int, method: Callable) -> Store:
        module = getattr(method, "__self__", method)
        parts = list(module.modules()) if isinstance(module, torch.nn.Module) else []
        training = [part for part in parts if part.training]
        for part in training:
            part.training = False
        try:
            with torch.no_grad():
                out = f"{self._out}/step-{step:08}"
                return evaluate(method, self._protocols, data=self._data, out=out, **self._options_for(module))
        finally:
            for part in training:
                part.training = True

    def _options_for(self, module: Any) -> dict[str, Any]:
        if not isinstance(module, torch.nn.Module):
            return {"resume": False, **self._options}
        stated = self._options.get("parameters") or {}
        return {**self._options, "parameters": {**stated, "state-sha256": state_hash(module)}}


def state_hash(module: torch.nn.Module) -> str:
    """SHA-256 of a module's ``state_dict``: names, types, shapes and bytes, in the order of the names."""
    digest = hashlib.sha256()
    for name, value in sorted(module.state_dict().items(), key=lambda item: item[0]):
        digest.update(f"{name}\n".encode())
        if isinstance(value, torch.Tensor) and value.layout == torch.strided and not value.is_quantized:
            digest.update(f"{value.dtype} {tuple(value.shape)}\n".encode())
            # As bytes, because NumPy has no bfloat16.
            digest.update(value.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy())
        else:
            digest.update(pickle.dumps(value))
    return digest.hexdigest()


def worse(of: Drift) -> list[dict[str, Any]]:
    """The comparisons whose mean is worse than the baseline's beyond its limit."""
    higher = {metric["id"] for metric in metrics() if metric["better"] == "higher"}

    def is_worse(one: dict[str, Any]) -> bool:
        if one["verdict"] != "drifted" or one["now"] is None or one["baseline"] is None:
            return one["verdict"] == "drifted"
        return one["now"] < one["baseline"] if one["metric"] in higher else one["now"] > one["baseline"]

    return [one for one in of.comparisons if is_worse(one)]
