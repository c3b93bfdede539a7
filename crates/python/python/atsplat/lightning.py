"""For Lightning: evaluation while a model trains. Importing this module imports Lightning (or PyTorch Lightning) and PyTorch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

try:
    from lightning.pytorch import Callback
except ImportError:
    from pytorch_lightning import Callback

from ._arrays import invalid
from .errors import AtsplatError
from .torch import Evaluation

#: Strategies whose processes hold parts of the parameters, which no process can evaluate on its own.
SHARDED = {"FSDPStrategy", "DeepSpeedStrategy", "ModelParallelStrategy"}


class EvaluationCallback(Callback):
    """Evaluates a model every N optimiser steps, on the first process, and stops the training with
    :class:`atsplat.DriftedError` if it is worse than a baseline.

    Other processes wait for the first, and fail with it (with an :class:`atsplat.AtsplatError` that says why). The time-out of their
    process group must be longer than an evaluation: ``DDPStrategy(timeout=timedelta(hours=2))``.

    Args:
        evaluation: what is evaluated, when, and against which baseline.
        method: makes the method of a module: ``method(context_images, context_cameras, target_cameras)``; by default the module
            itself.
    """

    def __init__(self, evaluation: Evaluation, method: Callable[[Any], Callable[..., Any]] | None = None) -> None:
        super().__init__()
        self.evaluation = evaluation
        self._method = method
        self._done = 0

    def on_fit_start(self, trainer: Any, pl_module: Any) -> None:
        """Raises an :class:`atsplat.InvalidError` if several processes hold parts of the model."""
        found = SHARDED.intersection(of.__name__ for of in type(trainer.strategy).__mro__)
        if found and trainer.world_size > 1:
            problem = f"expected one whose first process has the whole model, such as ddp, found {min(found)}"
            raise invalid("strategy", f"{problem}: evaluate its checkpoints instead")

    def on_train_batch_end(self, trainer: Any, pl_module: Any, *_: Any) -> None:
        # With accumulated gradients, several batches end on one step.
        step = trainer.global_step
        if step == self._done or not self.evaluation.is_due(step):
            return
        self._done = step
        error = self._evaluated(step, pl_module) if trainer.is_global_zero else None
        if trainer.world_size > 1:
            # The others wait here.
            problem = trainer.strategy.broadcast(None if error is None else f"{type(error).__name__}: {error}")
            if problem is not None and error is None:
                error = AtsplatError(f"the evaluation failed on the first process: {problem}")
        if error is not None:
            raise error

    def _evaluated(self, step: int, module: Any) -> Exception | None:
        try:
            self.evaluation(step, module if self._method is None else self._method(module))
        except Exception as error:
            return error
        return None
