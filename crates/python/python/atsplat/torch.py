"""For PyTorch: trials as a dataset, and evaluation while a model trains. Importing this module imports PyTorch."""

from __future__ import annotations

import hashlib
import operator
import warnings
from collections.abc import Callable, Sequence
from os import PathLike, fspath
from typing import Any

import torch
from torch.utils.data import Dataset

from ._arguments import at_most, whole
from ._arrays import invalid
from ._identity import modules as modules_of
from ._identity import state_hash as hash_of_state
from ._methods import STATE, name_of
from .cameras import Cameras
from .drift import Drift, drift
from .errors import DriftedError
from .evaluation import evaluate
from .metrics import metrics
from .protocols import Data, Protocol, Skipped, check_setting, protocol
from .stores import Store

Path = str | PathLike[str]


class TrialDataset(Dataset[dict[str, Any]]):
    """The trials of a protocol as tensors, for data loaders with any number of workers.

    An item is a dict of ``scene`` and ``entry``, ``near_far`` (2), and for ``context`` and ``target`` each: ``context_frames`` (V,
    positions in the scene), ``context_images`` (V × 3 × H × W, float32 in [0, 1]), ``context_world_from_camera`` (V × 4 × 4, float32,
    OpenCV axes) and ``context_intrinsics`` (V × 3 × 3, float32, in units of the image's size); lens distortion is left out, with a
    warning. ``target_images`` are only there with ``supervise=True``, for training: a method under evaluation may not see them.

    Args:
        of: a protocol, by name or opened.
        data: the dataset's path, or opened data, which each worker of a data loader opens again.
        limit: at most this many scenes, spread evenly over the index.
        setting: whose published pose normalisation, near and far planes are used.
        supervise: whether items have the targets' images.
        options: as for :meth:`atsplat.Protocol.open`.
    """

    def __init__(
        self,
        of: str | Protocol,
        data: Path | Data,
        *,
        limit: int | None = None,
        setting: str = "ATSplat",
        supervise: bool = False,
        **options: Any,
    ) -> None:
        self._setting, self._supervise = setting, supervise
        resolved = of if isinstance(of, Protocol) else protocol(of)
        self._data: Data | None = resolved.open(data, **options)
        self._source = resolved._source, *self._data._source
        self._warned_of_lenses = False
        check_setting(self._opened().protocol, setting)
        # No image is decoded for that.
        trials = self._opened()._native.trials(setting, at_most(limit), None, False)
        self._entries: list[tuple[str, int]] = []
        #: Entries of the index that have no trial, and so no item, with the reason; also those of scenes that the data lack.
        self.skipped: list[Skipped] = self._opened().missing
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
            name, path, options = self._source
            self._data = protocol(name).open(path, **options)
        return self._data

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, at: int) -> dict[str, Any]:
        try:
            scene, entry = self._entries[operator.index(at)]
        except TypeError:
            raise invalid("item", f"expected an integer, found {at!r}: torch.utils.data.Subset takes several") from None
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
            item[f"{views}_frames"] = torch.tensor(posed.frames)
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

    The modules that a method is, contains or uses (in its closure, attributes, arguments of ``functools.partial`` or globals) run in
    ``eval`` mode. Their state is a parameter of the method (``state-sha256``, see :func:`state_hash`): an interrupted evaluation is
    resumed with the same state, and the store of another training is an error, not the result. A callable without a module is a
    warning, and a folder that already contains results is an error for it, unless ``resume=True``.

    With several processes, call it on one of them, with the model itself (``model.module`` of ``DistributedDataParallel``), and let the
    others wait: :class:`atsplat.lightning.EvaluationCallback` does that.

    Args:
        protocols: as for :func:`atsplat.evaluate`.
        data: the dataset.
        out: folder for one store of each evaluated step, ``step-00005000``.
        every: number of steps between evaluations; step 0 is not evaluated.
        baseline: the file of :func:`atsplat.accept_baseline`; without it, nothing fails. Methods are compared by name (``name``): a
            baseline of other names fails, because no number is compared.
        fail: ``worse`` fails if a mean is worse than the baseline's beyond its limit, or if a target that was scored there has failed,
            ``any`` on every drift.
        module: the module, or modules, that the method runs, if they are not found in it.
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
        module: torch.nn.Module | Sequence[torch.nn.Module] | None = None,
        **options: Any,
    ) -> None:
        every = whole(every, "every")
        if fail not in ("worse", "any"):
            raise invalid("fail", f"expected worse or any, found {fail!r}")
        self._protocols, self._data, self._out = protocols, data, fspath(out)
        self._every, self._baseline, self._fail, self._options = every, baseline, fail, options
        self._modules = None if module is None else [module] if isinstance(module, torch.nn.Module) else list(module)
        #: The stores so far, by step.
        self.stores: dict[int, Store] = {}
        #: The last comparison with the baseline.
        self.drift: Drift | None = None

    def __call__(self, step: int, method: Callable[..., Any]) -> Store | None:
        """Evaluates ``method`` if it is time to, its modules in ``eval`` mode and without gradients.

        Raises:
            DriftedError: if it is worse than the baseline, if targets fail that were scored there, or if no number was compared.
            InvalidError: if what ``method`` uses cannot be gone through to find modules; those of :func:`atsplat.evaluate`.
        """
        if not self.is_due(step):
            return None
        store = self.stores[step] = self._evaluate(step, method)
        if self._baseline is not None:
            self.drift = drift(store, self._baseline)
            is_guarded = self.drift.verdict != "nothing" and any(one["verdict"] != "nothing" for one in self.drift.comparisons)
            if not is_guarded or (self._fail == "any" and self.drift.drifted) or worse(self.drift):
                raise DriftedError(self.drift)
        return store

    def is_due(self, step: int) -> bool:
        """Whether it is time to."""
        return step != 0 and step % self._every == 0

    def _evaluate(self, step: int, method: Callable[..., Any]) -> Store:
        modules = modules_of(method) if self._modules is None else self._modules
        if not modules:
            text = f"no module was found in {name_of(method)}: its mode (training or not) stays as it is; module=… names modules"
            warnings.warn(text, stacklevel=3)
        training = {id(part): part for module in modules for part in module.modules() if part.training}.values()
        for part in training:
            part.training = False
        try:
            with torch.no_grad():
                out = f"{self._out}/step-{step:08}"
                return evaluate(method, self._protocols, data=self._data, out=out, **self._options_for(modules))
        finally:
            for part in training:
                part.training = True

    def _options_for(self, modules: list[torch.nn.Module]) -> dict[str, Any]:
        if not modules:
            return {"resume": False, **self._options}
        stated, hashes = self._options.get("parameters") or {}, [state_hash(module) for module in modules]
        state = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
        return {**self._options, "parameters": {**stated, STATE: state}}


def state_hash(module: torch.nn.Module) -> str:
    """SHA-256 of a module's state, as 64 hexadecimal digits: names, types, shapes and values of its parameters and buffers, also of those
    that its ``state_dict`` leaves out, and of what else is in that; in the order of the names."""
    return hash_of_state(module)


def worse(of: Drift) -> list[dict[str, Any]]:
    """The comparisons whose mean is worse than the baseline's beyond its limit, and targets that were scored and have failed."""
    higher = {metric["id"] for metric in metrics() if metric["better"] == "higher"}

    def is_worse(one: dict[str, Any]) -> bool:
        if one["verdict"] != "drifted" or one["now"] is None or one["baseline"] is None:
            return bool(one["verdict"] == "drifted")
        return bool(one["now"] < one["baseline"] if one["metric"] in higher else one["now"] > one["baseline"])

    return [one for one in of.comparisons if is_worse(one)] + [{"lost": target} for target in of.lost]
