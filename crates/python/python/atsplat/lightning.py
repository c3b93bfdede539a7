"""For Lightning: evaluation while a model trains. Importing this module imports Lightning (or PyTorch Lightning) and PyTorch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

try:
    from lightning.pytorch import Callback
except ImportError:
    from pytorch_lightning import Callback

from .torch import Evaluation


class EvaluationCallback(Callback):
    """Evaluates a model every N optimiser steps, on the first process, and stops the training with
    :class:`atsplat.DriftedError` if it is worse than a baseline.

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

    def on_train_batch_end(self, trainer: Any, pl_module: Any, *_: Any) -> None:
        # With accumulated gradients, several batches end on one step.
        step = trainer.global_step
        if trainer.is_global_zero and step != self._done:
            self._done = step
            self.evaluation(step, pl_module if self._method is None else self._method(pl_module))
